use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::PathBuf;

use sonoloop_types::{NeedleSpec, ProbeSpec};

use super::{arm, named_file, phantom, tools};
use crate::document::Document;
use crate::{ArmSpec, LoadError, NeedleRobotSpec, PhantomSpec};

/// The files that a scenario names, each read once however many variants of the scenario are checked.
#[derive(Default)]
pub(crate) struct Library {
    arms: Shelf<ArmSpec>,
    needle_robots: Shelf<NeedleRobotSpec>,
    probes: Shelf<ProbeSpec>,
    needles: Shelf<NeedleSpec>,
    phantoms: Shelf<PhantomSpec>,
}

struct Shelf<T>(RefCell<BTreeMap<PathBuf, T>>);

impl<T> Default for Shelf<T> {
    fn default() -> Self {
        Self(RefCell::default())
    }
}

impl<T: Clone> Shelf<T> {
    fn take(
        &self,
        document: &Document,
        key: &str,
        relative: &str,
        check: impl Fn(&Document) -> Result<T, LoadError>,
    ) -> Result<T, LoadError> {
        let path = named_file(document, key, relative)?;
        if let Some(known) = self.0.borrow().get(&path) {
            return Ok(known.clone());
        }
        let checked = check(&Document::read(&path)?)?;
        self.0.borrow_mut().insert(path, checked.clone());
        Ok(checked)
    }
}

impl Library {
    /// The arm of the file `relative`, which `robot` of the scenario names; the others alike.
    pub(super) fn arm(&self, scenario: &Document, relative: &str) -> Result<ArmSpec, LoadError> {
        self.arms.take(scenario, "robot", relative, arm::arm)
    }

    pub(super) fn needle_robot(
        &self,
        scenario: &Document,
        relative: &str,
    ) -> Result<NeedleRobotSpec, LoadError> {
        self.needle_robots.take(scenario, "needle_robot", relative, arm::needle_robot)
    }

    pub(super) fn probe(&self, scenario: &Document, relative: &str) -> Result<ProbeSpec, LoadError> {
        self.probes.take(scenario, "probe", relative, tools::probe)
    }

    pub(super) fn needle(&self, scenario: &Document, relative: &str) -> Result<NeedleSpec, LoadError> {
        self.needles.take(scenario, "needle", relative, tools::needle)
    }

    pub(super) fn phantom(&self, scenario: &Document, relative: &str) -> Result<PhantomSpec, LoadError> {
        self.phantoms.take(scenario, "phantom", relative, phantom)
    }
}

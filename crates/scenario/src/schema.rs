use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use schemars::JsonSchema;
use schemars::generate::SchemaSettings;

use crate::raw::{RawMaterials, RawNeedle, RawNeedleRobot, RawPhantom, RawProbe, RawRobot, RawScenario};

/// The kinds of file that people write.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileKind {
    /// `scenarios/**`.
    Scenario,
    /// `robots/<name>/robot.yaml` of an arm.
    Robot,
    /// `robots/<name>/robot.yaml` of a needle robot.
    NeedleRobot,
    /// `robots/probes/*`.
    Probe,
    /// `robots/needles/*`.
    Needle,
    /// `phantoms/*`.
    Phantom,
    /// `phantoms/materials.yaml`.
    Materials,
}

impl FileKind {
    /// Every kind.
    pub const ALL: [Self; 7] = [
        Self::Scenario,
        Self::Robot,
        Self::NeedleRobot,
        Self::Probe,
        Self::Needle,
        Self::Phantom,
        Self::Materials,
    ];

    /// Name as in the schema's file name, `docs/schema/<name>.schema.json`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Scenario => "scenario",
            Self::Robot => "robot",
            Self::NeedleRobot => "needle_robot",
            Self::Probe => "probe",
            Self::Needle => "needle",
            Self::Phantom => "phantom",
            Self::Materials => "materials",
        }
    }

    /// The kind that a file says it is of, by the schema that its first line names for editors
    /// (`# yaml-language-server: $schema=…/<name>.schema.json`). `None` where it names none or cannot be read.
    pub fn of_file(path: &Path) -> Option<Self> {
        let mut first = String::new();
        // No first line that names a schema is anywhere near as long.
        let mut reader = BufReader::new(File::open(path).ok()?.take(1000));
        reader.read_line(&mut first).ok()?;
        let schema = first.trim_end().strip_prefix("# yaml-language-server: $schema=")?;
        let name = Path::new(schema).file_name()?.to_str()?.strip_suffix(".schema.json")?;
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }
}

/// The JSON schema (draft 2020-12) of a kind of file, for editors. It holds keys, types and single ranges; what
/// takes more than one value to judge is checked by [`crate::load()`] alone.
pub fn schema(kind: FileKind) -> serde_json::Value {
    fn of<T: JsonSchema>(name: &str) -> serde_json::Value {
        let mut schema = SchemaSettings::draft2020_12().into_generator().into_root_schema_for::<T>();
        schema.insert("title".to_owned(), format!("sonoloop {name} file").into());
        schema.to_value()
    }
    let name = kind.name();
    match kind {
        FileKind::Scenario => of::<RawScenario>(name),
        FileKind::Robot => of::<RawRobot>(name),
        FileKind::NeedleRobot => of::<RawNeedleRobot>(name),
        FileKind::Probe => of::<RawProbe>(name),
        FileKind::Needle => of::<RawNeedle>(name),
        FileKind::Phantom => of::<RawPhantom>(name),
        FileKind::Materials => of::<RawMaterials>(name),
    }
}

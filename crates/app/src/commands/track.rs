//! `sonoloop track`: the tracker's half of a run, or the tracker alone on recorded images.

use std::time::Duration;

use sonoloop_types::Image;
use sonoloop_wire::{Domain, Next, TrackerEndpoint};

use crate::cli::TrackArgs;
use crate::controller::{Controller, ControllerKind};
use crate::error::{AppError, Outcome};
use crate::null::Null;
use crate::track_recorded;

/// How long a tracker looks for its run's services.
const OPEN_TIMEOUT: Duration = Duration::from_secs(10);
/// Waits for a picture are this long, so that the end of a silent simulator is noticed.
const WAIT: Duration = Duration::from_secs(1);

/// Joins a run, or tracks a recording.
pub fn track(args: &TrackArgs) -> Result<Outcome, AppError> {
    if let Some(recorded) = &args.recorded {
        track_recorded::run(recorded, args.settings.settings()?)?;
        return Ok(Outcome::Pass);
    }
    let from_environment = std::env::var_os(sonoloop_wire::DOMAIN_VARIABLE).is_some();
    if args.domain.is_none() && !from_environment {
        return Err(AppError::BadInput(
            "error: give a recording (SEQUENCE --init U,V), or the run to join (--domain NAME --root DIR)"
                .into(),
        ));
    }
    let domain = match (&args.domain, &args.root) {
        (Some(name), Some(root)) => Domain::open(name, root),
        _ => Domain::from_environment(),
    };
    let kind = match args.null.as_deref() {
        None => ControllerKind::Tracker,
        Some(name) => ControllerKind::Null(Null::from_name(name).ok_or_else(|| {
            let known: Vec<&str> = Null::ALL.iter().map(|(name, _)| *name).collect();
            AppError::BadInput(format!("error: --null {name}: known are {}", known.join(", ")))
        })?),
    };
    attached(&domain.map_err(AppError::bad_input)?, kind).map_err(AppError::fault)?;
    Ok(Outcome::Pass)
}

/// Answers every picture of a run until it ends.
fn attached(domain: &Domain, kind: ControllerKind) -> Result<(), Box<dyn std::error::Error>> {
    let endpoint = TrackerEndpoint::open(domain, OPEN_TIMEOUT)?;
    let setup = endpoint.setup().clone();
    let mut image = Image::black(setup.geometry.width_px, setup.geometry.height_px);
    let mut controller = match endpoint.restore() {
        Some(bytes) => Controller::restore(setup, kind, bytes)?,
        None => Controller::new(setup, kind),
    };
    endpoint.announce(kind.name(), env!("CARGO_PKG_VERSION"))?;
    loop {
        match endpoint.next_image(&mut image, WAIT)? {
            Next::Image(acquisition) => {
                let command = controller.answer(&acquisition, &image);
                // Before the answer: once the simulator has the answer to image k, it has its checkpoint too.
                endpoint.publish_checkpoint(&controller.checkpoint())?;
                endpoint.answer(&command)?;
            }
            Next::TimedOut => {}
            Next::End(_) | Next::SimulatorGone | Next::Interrupted => return Ok(()),
        }
    }
}

//! `sonoloop replay`: a recorded run again, compared image by image.

use super::run::{VERSION, run_id};
use crate::cli::FolderArgs;
use crate::error::{AppError, Outcome};
use crate::progress::Progress;
use crate::replay::{Compared, Recorded, ReplayError};
use crate::say::say;
use crate::scenarios::prepare;

/// Runs it again and says whether everything is the same.
pub fn replay(args: &FolderArgs) -> Result<Outcome, AppError> {
    sonoloop_ultrasound::draw_on_this_thread();
    let bad_input = |error: ReplayError| AppError::bad_input(format_args!("error: {error}"));
    let recorded = Recorded::read(&args.folder).map_err(bad_input)?;
    let (scenario, session) = prepare(&args.folder.join("scenario.yaml"), None, &[])?;
    let version = &recorded.summary.version;
    if version != VERSION {
        eprintln!("recorded by sonoloop {version}, run again by {VERSION}: what differs may come from that");
    }
    let mut progress = Progress::new(&scenario);
    let compared = recorded.compare(&scenario, session, run_id(), &mut progress);
    progress.finish();
    match compared.map_err(AppError::fault)? {
        Compared::Same { images, events } => {
            say(format_args!("{images} images and {events} events, all the same"));
            Ok(Outcome::Pass)
        }
        Compared::Differs(difference) => {
            say(format_args!("differs: {difference}"));
            Ok(Outcome::Fail)
        }
    }
}

use sonoloop_types::{TICKS_PER_SECOND, View};

use super::units::ticks;
use super::{Library, insertion, settings, timeline};
use crate::document::Document;
use crate::raw::{RawScenario, RawView};
use crate::{LoadError, Scenario};

/// The scenario of a resolved document, and of every file that it names.
pub(crate) fn build(document: &Document, library: &Library) -> Result<Scenario, LoadError> {
    let raw: RawScenario = document.typed()?;
    let rate = u64::from(raw.image_rate_hz);
    if !TICKS_PER_SECOND.is_multiple_of(rate) {
        let message = format!("must divide the {TICKS_PER_SECOND} ticks of a second");
        return Err(document.fail("image_rate_hz", message));
    }
    let (duration_ticks, image_period_ticks) = (ticks(raw.duration_s), TICKS_PER_SECOND / rate);
    let images = raw.images.map(u64::from);
    if let Some(images) = images.filter(|images| images * image_period_ticks > duration_ticks) {
        let most = duration_ticks / image_period_ticks;
        let message = format!("must be at most {most}, the images of duration_s = {}", raw.duration_s);
        return Err(document.fail_value("images", images as f64, message));
    }
    let arm = library.arm(document, &raw.robot)?;
    let needle_robot = library.needle_robot(document, &raw.needle_robot)?;
    let probe = library.probe(document, &raw.probe)?;
    let needle = library.needle(document, &raw.needle)?;
    let phantom = library.phantom(document, &raw.phantom)?;
    let geometry = &probe.geometry;
    let insertion =
        insertion::insertion(document, &raw.insertion, &phantom, &needle, &needle_robot, geometry)?;
    let tracker = settings::tracker(document, &raw.tracker, raw.view)?;
    let placement =
        insertion::placement(document, &raw.placement, &insertion, tracker.template_px, geometry)?;
    settings::contact_force(document, raw.placement.contact_force_n, &raw.limits)?;

    Ok(Scenario {
        name: raw.name.map_or_else(|| stem(document), Ok)?,
        description: raw.description,
        source: document.source.path.clone(),
        seed: raw.seed,
        duration_ticks,
        images,
        image_period_ticks,
        view: match raw.view {
            RawView::Lateral => View::Lateral,
            RawView::Transverse => View::Transverse,
        },
        limits: settings::limits(document, &raw.limits, &needle_robot)?,
        servo: settings::servo(document, &raw.servo, &raw.limits)?,
        calibration: settings::calibration(&raw.calibration),
        delays: settings::delays(&raw.delays),
        disturbances: timeline::disturbances(document, &raw.disturbances, raw.duration_s)?,
        expect: timeline::expectations(document, &raw.expect)?,
        resolved_yaml: document.source.text.to_string(),
        arm,
        needle_robot,
        probe,
        needle,
        phantom,
        insertion,
        placement,
        tracker,
    })
}

/// The file's name without its ending.
fn stem(document: &Document) -> Result<String, LoadError> {
    let stem = document.source.path.file_stem().and_then(|stem| stem.to_str());
    stem.map(str::to_owned).ok_or_else(|| document.fail("", "needs a `name`: its file name is no text"))
}

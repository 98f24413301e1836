//! What is in the atlas.

use std::path::Path;

use sonoloop_types::ProbeSpec;

use super::super::view::{NeedleView, View};

/// A phantom to be pictured.
#[derive(Debug)]
pub struct PhantomFile {
    /// File name without folder and ending.
    pub stem: String,
    /// Its name and what its file says about it, one sentence.
    pub note: String,
}

impl PhantomFile {
    /// Takes the note from the file's first comments; a file without any is known by its name.
    pub fn new(stem: &str, file: &Path, name: &str) -> Self {
        let text = std::fs::read_to_string(file).unwrap_or_default();
        let comment: Vec<&str> = text
            .lines()
            .map_while(|line| line.strip_prefix('#'))
            .map(str::trim)
            .filter(|line| !line.starts_with("yaml-language-server"))
            .collect();
        let comment = comment.join(" ");
        let first = comment.split_once(". ").map_or(comment.as_str(), |(first, _)| first);
        let note = if first.is_empty() { name } else { first.trim_end_matches('.') };
        Self { stem: stem.to_owned(), note: format!("{note}.") }
    }
}

/// One picture.
#[derive(Debug)]
pub struct Picture {
    /// Name of its file.
    pub file: String,
    /// One sentence.
    pub caption: String,
    /// Stem of the phantom's file.
    pub phantom: String,
    /// Probe and needle.
    pub view: View,
    /// What is changed about the probe's settings.
    pub tune: Option<Tune>,
}

/// Turns a knob of the scanner.
pub type Tune = fn(&mut ProbeSpec);

/// Pictures that are to be compared with one another.
#[derive(Debug)]
pub struct Section {
    /// Heading.
    pub title: &'static str,
    /// What to look for.
    pub note: &'static str,
    /// In the order of the page.
    pub pictures: Vec<Picture>,
}

/// A needle whose tip is in the middle of the picture, 25 mm deep.
fn lateral(angle_deg: f64) -> NeedleView {
    NeedleView {
        angle_rad: angle_deg.to_radians(),
        tip_depth_m: 25e-3,
        offset_m: 0.0,
        transverse: false,
        yaw_rad: 0.0,
    }
}

fn with(needle: NeedleView) -> View {
    View { needle: Some(needle), ..View::default() }
}

/// The whole atlas. `main` is the stem of the phantom in which everything but the phantoms is shown.
pub fn sections(phantoms: &[PhantomFile], main: &str) -> Vec<Section> {
    let of_main = |name: &str, caption: String, view: View| Picture {
        file: format!("{name}.png"),
        caption,
        phantom: main.to_owned(),
        view,
        tune: None,
    };
    let is_there = |picture: &Picture| phantoms.iter().any(|phantom| phantom.stem == picture.phantom);
    let of = |phantom: &str, name: &str, caption: &str, view: View, tune: Option<Tune>| Picture {
        file: format!("{name}.png"),
        caption: caption.to_owned(),
        phantom: phantom.to_owned(),
        view,
        tune,
    };
    vec![
        Section {
            title: "Phantoms",
            note: "Each phantom from the middle of its top face, and the same plane with a needle at 40°, its tip \
                   25 mm deep in the middle of the picture.",
            pictures: phantoms.iter().flat_map(both).collect(),
        },
        Section {
            title: "Needle in the plane, by angle",
            note: "Tip 25 mm deep in the middle. A flat shaft sends its echo back to the probe and repeats below \
                   itself; an oblique one sends it away, and roughness and tip are all that is left. The shadow fills \
                   with depth, where the aperture looks past the shaft.",
            pictures: angles()
                .map(|(name, caption, angle)| of_main(name, caption, with(lateral(angle))))
                .into(),
        },
        Section {
            title: "Needle across the plane",
            note: "A needle at 30° crosses the picture from behind: a spot, whether it is the tip or the shaft, and a shadow.",
            pictures: transverse().map(|(name, caption, needle)| of_main(name, caption, with(needle))).into(),
        },
        Section {
            title: "Needle beside the plane",
            note: "The slice is 1.0 mm thick at 25 mm and 2.2 mm at 40 mm, where the tip is: the deeper the needle, \
                   the farther beside the plane it is still seen.",
            pictures: offsets().map(|(name, caption, needle)| of_main(name, caption, with(needle))).into(),
        },
        Section {
            title: "Contact",
            note: "Air under part of the array: those elements neither send nor hear, and ring by themselves.",
            pictures: contact().map(|(name, caption, view)| of_main(name, caption, view)).into(),
        },
        Section {
            title: "Effects, one by one",
            note: "The same plane through simple anatomy with one effect switched off in each picture: what is missing is \
                   what the effect does. The last two belong to pictures above: the flat needle, and the needle in water.",
            pictures: effects()
                .map(|(name, caption, tune)| of("anatomy", name, caption, anatomy(), tune))
                .into_iter()
                .chain(effects_elsewhere().map(|(phantom, name, caption, angle_deg, tune)| {
                    of(phantom.unwrap_or(main), name, caption, with(lateral(angle_deg)), Some(tune))
                }))
                .filter(is_there)
                .collect(),
        },
        Section {
            title: "Knobs of the scanner",
            note: "The same needle at 40°, the same gel.",
            pictures: knobs()
                .map(|(name, caption, tune)| of(main, name, caption, with(lateral(40.0)), Some(tune)))
                .into(),
        },
        Section {
            title: "Settings and pose",
            note: "The same needle at 40°, seen with other gains and by a probe that leans or is turned.",
            pictures: settings().map(|(name, caption, view)| of_main(name, caption, view)).into(),
        },
    ]
}

fn both(phantom: &PhantomFile) -> [Picture; 2] {
    let PhantomFile { stem, note } = phantom;
    let picture = |suffix: &str, caption: String, view: View| Picture {
        file: format!("phantom_{stem}{suffix}.png"),
        caption,
        phantom: stem.clone(),
        view,
        tune: None,
    };
    [
        picture("", note.clone(), View::default()),
        picture("_needle", format!("{stem} with a needle at 40°."), with(lateral(40.0))),
    ]
}

fn angles() -> [(&'static str, String, f64); 6] {
    [
        ("angle_00", "0°: the flat shaft is as bright as a needle gets, with its repeats below.".into(), 0.0),
        ("angle_10", "10°: most of the echo already misses the aperture.".into(), 10.0),
        ("angle_20", "20°: the shaft is seen by its roughness alone.".into(), 20.0),
        ("angle_30", "30°: a usual angle of insertion.".into(), 30.0),
        ("angle_45", "45°: a grainy shaft and a bright tip.".into(), 45.0),
        ("angle_60", "60°: a steep needle.".into(), 60.0),
    ]
}

fn transverse() -> [(&'static str, String, NeedleView); 4] {
    let needle =
        |offset_mm: f64| NeedleView { transverse: true, offset_m: offset_mm * 1e-3, ..lateral(30.0) };
    [
        ("transverse_before", "The tip 1 mm short of the plane: a first glimmer.".into(), needle(-1.0)),
        ("transverse_tip", "The tip in the plane.".into(), needle(0.0)),
        (
            "transverse_shaft",
            "The tip 8 mm past the plane: the spot is the shaft, and fainter.".into(),
            needle(8.0),
        ),
        (
            "transverse_flat",
            "A needle that lies flat, its tip 8 mm past the plane: a short bright arc, its repeats run together below it."
                .into(),
            NeedleView { angle_rad: 0.0, ..needle(8.0) },
        ),
    ]
}

fn offsets() -> [(&'static str, String, NeedleView); 4] {
    let needle =
        |offset_mm: f64| NeedleView { offset_m: offset_mm * 1e-3, tip_depth_m: 40e-3, ..lateral(40.0) };
    [
        ("offset_0mm", "In the plane, the tip 40 mm deep.".into(), needle(0.0)),
        ("offset_1mm", "1 mm beside it: specks of the shaft are left, and the tip.".into(), needle(1.0)),
        ("offset_2mm", "2 mm beside it: nothing stands out of the speckle.".into(), needle(2.0)),
        ("offset_3mm", "3 mm beside it: nothing.".into(), needle(3.0)),
    ]
}

fn contact() -> [(&'static str, String, View); 4] {
    let view = |from: f64, to: f64| View { lifted: from..to, ..with(lateral(40.0)) };
    [
        (
            "contact_left",
            "The left third without contact: bands of ringing, and the shaft gone beneath.".into(),
            view(0.0, 0.33),
        ),
        (
            "contact_middle",
            "An air bubble of 5 mm under the middle: a dark wedge that fills with depth.".into(),
            view(0.435, 0.565),
        ),
        (
            "contact_slanted",
            "Lifted on the left by 1 mm: gel follows the face for a while, so the bands slant at the edge of contact."
                .into(),
            View { slanted: true, ..view(0.0, 0.6) },
        ),
        ("contact_none", "No contact at all: ringing, then noise.".into(), view(0.0, 1.0)),
    ]
}

/// The needle behind the cyst, its shadow on the lump.
fn anatomy() -> View {
    with(NeedleView { tip_depth_m: 20e-3, ..lateral(30.0) })
}

fn effects() -> [(&'static str, &'static str, Option<Tune>); 6] {
    [
        ("effects_all", "Everything on.", None),
        (
            "effects_no_boundaries",
            "No surfaces: the bone and the fascia lose their gloss.",
            Some(|probe| probe.effects.boundaries = false),
        ),
        (
            "effects_no_attenuation",
            "No attenuation: the bone throws no shadow, and the compensation makes the depth glow.",
            Some(|probe| probe.effects.attenuation = false),
        ),
        (
            "effects_no_sound_speed",
            "One sound speed: the bone is drawn as thick as it is, not as thin as its echoes are near in time.",
            Some(|probe| probe.effects.sound_speed = false),
        ),
        (
            "effects_no_downshift",
            "The pulse keeps its frequency: finer speckle at the bottom.",
            Some(|probe| probe.effects.downshift = false),
        ),
        (
            "effects_no_needle_shadow",
            "A needle that hides nothing.",
            Some(|probe| probe.effects.needle_shadow = false),
        ),
    ]
}

/// Effects that do not show in the anatomy: phantom (`None`: the main one), file, caption, angle of the needle, switch.
fn effects_elsewhere() -> [(Option<&'static str>, &'static str, &'static str, f64, Tune); 2] {
    [
        (
            None,
            "effects_no_reverberation",
            "No reverberation: the flat shaft without its repeats below.",
            0.0,
            |probe| probe.effects.reverberation = false,
        ),
        (
            Some("water"),
            "effects_no_side_lobes",
            "No side lobes: the tip in water without its arc.",
            40.0,
            |probe| probe.effects.side_lobes = false,
        ),
    ]
}

fn knobs() -> [(&'static str, &'static str, Tune); 6] {
    [
        ("knob_focus_15", "Transmit focus at 15 mm: the tip, 25 mm deep, is broad.", |probe| {
            probe.transmit_focus_m = Some(15e-3);
        }),
        ("knob_focus_25", "Transmit focus at the tip.", |probe| probe.transmit_focus_m = Some(25e-3)),
        ("knob_depth_80", "80 mm deep: the phantom's bottom is at 60 mm.", |probe| {
            probe.geometry.spacing_m = 80e-3 / f64::from(probe.geometry.height_px);
        }),
        ("knob_frequency_5", "5 MHz: coarser, and less noise at the bottom.", |probe| {
            probe.centre_frequency_hz = 5e6;
        }),
        ("knob_sliders", "Sliders pulled back in the middle.", |probe| {
            probe.tgc_sliders_db = vec![0.0, 0.0, -8.0, -14.0, -8.0, 0.0, 0.0, 0.0];
        }),
        ("knob_range_40", "A dynamic range of 40 dB: harder, with the same speckle level.", |probe| {
            probe.dynamic_range_db = 40.0;
            probe.speckle_level_db *= 40.0 / 60.0;
        }),
    ]
}

fn settings() -> [(&'static str, String, View); 6] {
    let needle = || with(lateral(40.0));
    let tilted = |tilt_deg: f64| View { tilt_rad: f64::to_radians(tilt_deg), ..needle() };
    // The needle stays where it is while the probe turns above it.
    let turned = |yaw_deg: f64| {
        let yaw_rad = f64::to_radians(yaw_deg);
        View { yaw_rad, ..with(NeedleView { yaw_rad, ..lateral(40.0) }) }
    };
    [
        ("gain_low", "Gain 12 dB down.".into(), View { gain_db: -12.0, ..needle() }),
        (
            "gain_high",
            "Gain 12 dB up: speckle and noise crowd the tip.".into(),
            View { gain_db: 12.0, ..needle() },
        ),
        ("tilt_15", "Probe and needle leaning by 15°: new speckle, the same needle.".into(), tilted(15.0)),
        ("tilt_30", "Leaning by 30°.".into(), tilted(30.0)),
        (
            "yaw_05",
            "Probe turned by 5° above the needle's tip: the shaft leaves the plane.".into(),
            turned(5.0),
        ),
        ("yaw_15", "Turned by 15°: the tip and little else.".into(), turned(15.0)),
    ]
}

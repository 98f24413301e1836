use sonoloop_types::{Effects, ElevationSample, ImageGeometry, NeedleSpec, Precision, ProbeSpec};

use super::units::{m, rad};
use crate::LoadError;
use crate::document::Document;
use crate::raw::{RawNeedle, RawPrecision, RawProbe};

/// The probe and its scanner.
pub(crate) fn probe(document: &Document) -> Result<ProbeSpec, LoadError> {
    let raw: RawProbe = document.typed()?;
    for (index, pair) in raw.elevation.windows(2).enumerate() {
        if pair[1].depth_mm <= pair[0].depth_mm {
            let key = format!("elevation.{}.depth_mm", index + 1);
            return Err(
                document.fail(&key, format!("must be above {}, the depth before it", pair[0].depth_mm))
            );
        }
    }
    let rows = ImageGeometry::default().height_px;
    let geometry = ImageGeometry { spacing_m: m(raw.depth_mm) / f64::from(rows), ..ImageGeometry::default() };
    let aperture_m = f64::from(raw.elements) * m(raw.pitch_mm);
    let width_m = f64::from(geometry.width_px) * geometry.spacing_m;
    if aperture_m > width_m + 1e-9 {
        let message = format!(
            "makes an array of {:.1} mm, must be at most {:.1} mm, the width of the picture",
            aperture_m * 1000.0,
            width_m * 1000.0
        );
        return Err(document.fail("pitch_mm", message));
    }
    let elevation = raw
        .elevation
        .iter()
        .map(|sample| ElevationSample { depth_m: m(sample.depth_mm), width_m: m(sample.width_mm) })
        .collect();
    Ok(ProbeSpec {
        name: raw.name,
        elements: raw.elements,
        pitch_m: m(raw.pitch_mm),
        centre_frequency_hz: raw.centre_frequency_mhz * 1e6,
        fractional_bandwidth: raw.fractional_bandwidth,
        f_number: raw.f_number,
        transmit_focus_m: raw.transmit_focus_mm.map(m),
        element_height_m: m(raw.element_height_mm),
        elevation_focus_m: m(raw.elevation_focus_mm),
        elevation,
        assumed_sound_speed_m_s: raw.assumed_sound_speed_m_s,
        tgc_db_cm_mhz: raw.tgc_db_cm_mhz,
        tgc_sliders_db: raw.tgc_sliders_db,
        dynamic_range_db: raw.dynamic_range_db,
        speckle_level_db: raw.speckle_level_db,
        noise_level_db: raw.noise_level_db,
        geometry,
        effects: Effects {
            attenuation: raw.effects.attenuation,
            downshift: raw.effects.downshift,
            sound_speed: raw.effects.sound_speed,
            boundaries: raw.effects.boundaries,
            reverberation: raw.effects.reverberation,
            needle_shadow: raw.effects.needle_shadow,
            side_lobes: raw.effects.side_lobes,
            speckle: raw.effects.speckle,
            specular: raw.effects.specular,
            contact: raw.effects.contact,
            noise: raw.effects.noise,
        },
        precision: match raw.precision {
            RawPrecision::Usual => Precision::Usual,
            RawPrecision::Fine => Precision::Fine,
        },
    })
}

/// The needle.
pub(crate) fn needle(document: &Document) -> Result<NeedleSpec, LoadError> {
    let raw: RawNeedle = document.typed()?;
    Ok(NeedleSpec {
        name: raw.name,
        outer_diameter_m: m(raw.outer_diameter_mm),
        length_m: m(raw.length_mm),
        bevel_rad: rad(raw.bevel_deg),
        curvature_per_m: raw.curvature_per_m,
        specular_level_db: raw.specular_level_db,
        rough_level_db: raw.rough_level_db,
        tip_level_db: raw.tip_level_db,
    })
}

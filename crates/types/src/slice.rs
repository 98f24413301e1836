use crate::{Drag, Indentation, NeedlePath, Pose};

/// All that an image depends on at one instant: what the world hands to the renderer.
#[derive(Debug, Clone, PartialEq)]
pub struct Slice {
    /// Number of the image, from 0; picks the electronic noise.
    pub sequence: u64,
    /// Where the probe is, seen from the phantom.
    pub phantom_from_probe: Pose,
    /// The needle, when one is in the phantom.
    pub needle: Option<NeedlePath>,
    /// Change of the needle's echo (1 = as specified); a disturbance.
    pub needle_gain_db: f64,
    /// Air or missing gel between each element and the surface; 0 = in contact. One entry per element.
    pub element_gap_m: Vec<f32>,
    /// What something in the way takes from sound that leaves and comes back through each element, decibels ≥ 0. One
    /// entry per element; empty for none. A disturbance.
    pub element_loss_db: Vec<f32>,
    /// How the tissue is pressed; `None` at rest, as is a press that tissue cannot follow
    /// ([`Indentation::is_sound`]). The needle is where its path says, pressed or not.
    pub indentation: Option<Indentation>,
    /// How the needle's tip carries tissue along; `None` when it does not. The needle is where its path says, drag or not.
    pub drag: Option<Drag>,
    /// Receiver gain on top of the probe's own; a disturbance or the user's knob.
    pub gain_db: f64,
    /// Electronic noise on top of the probe's own; a disturbance.
    pub noise_gain_db: f64,
}

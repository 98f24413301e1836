//! Echoes of the needle.
//!
//! The shaft's front wall is a coherent line plus roughness that is fixed in the steel: both are counted from
//! the tip backwards, as the steel moves with the tip. At the angles people insert at the aperture sees next
//! to nothing of the coherent line, and roughness and tip remain. Reverberation inside the steel repeats the
//! shaft below itself.

use sonoloop_types::{NeedleSpec, Pose, ProbeSpec, Slice, Vector};

use crate::{
    beam::{Beam, amplitude_from_db},
    echo::Echo,
    fast::exp_minus,
    lattice::mix,
    tape::BakedTape,
};

/// Sound speed in steel 304L, for the spacing of reverberations. [source] manufacturers' tables
const STEEL_SOUND_SPEED_M_S: f64 = 5790.0;
/// Reverberations drawn below the coherent line, and below a point of the roughness. [assumed]
const COHERENT_REVERBERATIONS: usize = 3;
const ROUGH_REVERBERATIONS: usize = 2;
/// Amplitude from one reverberation to the next. [assumed] Steel to tissue reflects −0.94 twice, but a thin
/// cylinder spreads the sound.
const REVERBERATION_GAIN: f64 = 0.35;
/// Lines around the front wall that stand for its coherent echo, as far to each side as the aperture sees a mirror: half
/// the cone's angle. Across the shaft they make a short arc.
const ARC_LINES: i32 = 2;
/// Roughness counts where the wall faces the probe within 60°, weighted cos²; mean of cos⁴ over the circle.
const ROUGH_MIN_COSINE: f64 = 0.5;
const ROUGH_MEAN_COS4: f64 = 0.1853;
/// Points of the roughness around the shaft, and their distance along it in steps of the coherent line. Sectors
/// take turns, so that the points of neighbours fill one another's gaps.
const SECTORS: usize = 8;
const ROUGH_STEPS: u64 = 4;
/// A coherent stretch that would sum to less than this share of the roughness is left out.
const COHERENT_SHARE: f64 = 0.1;
/// Nor is one drawn that stays below this over unit speckle.
const COHERENT_FLOOR: f64 = 0.02;
/// The coherent line fades in over this length at the entry.
const ENTRY_FADE_M: f64 = 1e-3;
/// Points of the bevel's facet behind the tip, their level and extent. [assumed]
const FACET_POINTS: usize = 6;
const FACET_GAIN: f64 = 0.3;
const FACET_LENGTH_M: f64 = 0.4e-3;
/// Bounces in the wedge of the tip, their spacing (half a wavelength of 7.5 MHz in tissue) and gain. [assumed]
const TIP_BOUNCES: usize = 4;
const TIP_BOUNCE_M: f64 = 0.1e-3;
const TIP_BOUNCE_GAIN: f64 = 0.42;
/// Share of the tip's echo that depends on the facet facing the probe. [assumed]
const FACET_SHARE: f64 = 0.3;
/// Side lobes of the tip: lines that look past it still hear it, at this level beside its own echo, falling off over
/// this distance. [assumed] A wide pedestal near −40 dB [memory]; speckle and the shaft have theirs far below the rest.
const LOBE_LEVEL_DB: f64 = -40.0;
const LOBE_SIGMA_M: f64 = 3e-3;
/// Lobes reach so many σ, and have an echo per this many σ of the beam.
const LOBE_REACH: f64 = 2.5;
const LOBE_STEP: f64 = 1.2;
/// Longest path that is drawn.
const MAX_LENGTH_M: f64 = 0.5;
/// Elevation beyond which even the tip's echo is far below noise, in σ.
const REACH: f64 = 4.1;

/// The steel's outline.
#[derive(Debug, Clone, Copy)]
pub struct Shaft {
    pub radius_m: f64,
    /// Length from the tip over which the bevel is ground.
    pub bevel_m: f64,
}

impl Shaft {
    pub fn new(spec: &NeedleSpec) -> Self {
        let radius_m = spec.outer_diameter_m / 2.0;
        Self { radius_m, bevel_m: 2.0 * radius_m / libm::tan(spec.bevel_rad.clamp(0.1, 1.5)) }
    }

    /// Distance of the wall from the middle line, so far behind the tip: there the steel is ground away.
    pub fn wall_m(&self, behind_tip_m: f64) -> f64 {
        self.radius_m * (behind_tip_m / self.bevel_m).min(1.0)
    }
}

/// The needle's constants and the picture's echoes.
pub struct NeedleEchoes {
    spec: NeedleSpec,
    reverberates: bool,
    side_lobes: bool,
    specular: bool,
    step_m: f64,
    seed: u64,
    /// cos and sin of the sectors' directions.
    around: [[f64; 2]; SECTORS],
    pub echoes: Vec<Echo>,
}

struct Sink<'a> {
    beam: &'a Beam,
    echoes: &'a mut Vec<Echo>,
}

impl Sink<'_> {
    /// Adds a point at (x, e, z) whose peak is `amplitude` over unit speckle, drawn `late_m` farther down.
    fn add(&mut self, at: [f64; 3], late_m: f64, amplitude: [f64; 2]) {
        self.push(at, late_m, amplitude, false);
    }

    fn push(&mut self, [x_m, e_m, z_m]: [f64; 3], late_m: f64, [re, im]: [f64; 2], unshaded: bool) {
        if z_m < 0.0 {
            return;
        }
        let sigma_m = self.beam.sigma_elevation_m(z_m);
        let u = e_m / sigma_m;
        if u.abs() > REACH {
            return;
        }
        let scale = self.beam.level_scale(x_m, z_m) * f64::from(exp_minus((0.5 * u * u) as f32));
        self.echoes.push(Echo { x_m, z_m, late_m, re: scale * re, im: scale * im, unshaded });
    }
}

impl Sink<'_> {
    /// What the lines beside a point hear of it: at its distance from them, so below it and farther down the farther
    /// they are.
    fn add_lobes(&mut self, at: Vector, amplitude: f64) {
        let step_m = LOBE_STEP * self.beam.sigma_lateral_m;
        for i in 1..=(LOBE_REACH * LOBE_SIGMA_M / step_m) as i32 {
            let aside_m = f64::from(i) * step_m;
            // Points so close that they add up to one line.
            let level = amplitude * libm::exp(-0.5 * (aside_m / LOBE_SIGMA_M).powi(2)) * LOBE_STEP
                / core::f64::consts::TAU.sqrt();
            let late_m = (at.z * at.z + aside_m * aside_m).sqrt() - at.z;
            // Each line hears the tip by itself: no sum over lines may weaken what lies aslant.
            let (sin, cos) = libm::sincos(self.beam.two_k_rad_m * late_m);
            for side in [-1.0, 1.0] {
                self.add([at.x + side * aside_m, at.y, at.z], late_m, [cos * level, sin * level]);
            }
        }
    }
}

impl NeedleEchoes {
    pub fn new(spec: &NeedleSpec, beam: &Beam, probe: &ProbeSpec, seed: u64) -> Self {
        let around = core::array::from_fn(|i| {
            let (sin, cos) = libm::sincos(core::f64::consts::TAU * i as f64 / SECTORS as f64);
            [cos, sin]
        });
        Self {
            spec: spec.clone(),
            reverberates: probe.effects.reverberation,
            side_lobes: probe.effects.side_lobes,
            specular: probe.effects.specular,
            step_m: beam.wavelength_m() / 8.0,
            seed: mix(seed ^ 0x6e65_6564_6c65_0000),
            around,
            echoes: Vec::new(),
        }
    }

    /// Lists the echoes of the slice's needle in [`Self::echoes`]; none without a needle.
    pub fn build(&mut self, beam: &Beam, tape: &BakedTape, slice: &Slice) {
        self.echoes.clear();
        let Some(needle) = &slice.needle else { return };
        let probe_from_phantom: Pose = slice.phantom_from_probe.inverse();
        let line: Vec<_> = needle.centreline_in_phantom.iter().map(|p| probe_from_phantom * p).collect();
        let bevel = probe_from_phantom * needle.bevel_normal_in_phantom;
        let axis = probe_from_phantom * needle.axis_in_phantom;
        let vectors = line.iter().map(|p| p.coords).chain([bevel, axis]);
        if vectors.flat_map(|v| [v.x, v.y, v.z]).any(|v| !v.is_finite()) {
            return;
        }
        let Some(tip) = line.last() else { return };
        let mut echoes = core::mem::take(&mut self.echoes);
        let mut sink = Sink { beam, echoes: &mut echoes };
        let gain = amplitude_from_db(slice.needle_gain_db);
        if gain.is_finite() {
            self.add_tip(&mut sink, tape, tip.coords, axis, bevel, gain);
            let lengths: Vec<f64> = line.windows(2).map(|w| (w[1] - w[0]).norm()).collect();
            let total_m: f64 = lengths.iter().sum();
            let mut behind_tip_m = 0.0;
            for (ends, &length_m) in line.windows(2).zip(&lengths).rev() {
                if length_m > 0.0 && behind_tip_m + length_m < MAX_LENGTH_M {
                    let piece = Piece {
                        end: ends[1].coords,
                        towards_tip: (ends[1] - ends[0]) / length_m,
                        bevel,
                        behind_tip_m,
                        length_m,
                        total_m,
                        gain,
                    };
                    self.add_piece(&mut sink, tape, &piece);
                }
                behind_tip_m += length_m;
            }
        }
        self.echoes = echoes;
    }

    /// Unit-power complex amplitude of a place on the steel.
    fn noise(&self, tape: &BakedTape, place: u64) -> [f32; 2] {
        tape.raw((mix(self.seed ^ place) >> 32) as usize)
    }

    fn add_tip(
        &self,
        sink: &mut Sink,
        tape: &BakedTape,
        tip: Vector,
        axis: Vector,
        bevel: Vector,
        gain: f64,
    ) {
        let facing = (-bevel.z).max(0.0);
        let level =
            gain * amplitude_from_db(self.spec.tip_level_db) * (1.0 - FACET_SHARE + FACET_SHARE * facing);
        // Sound rings down in the thin wedge behind the edge: a short tail, weaker with every bounce.
        let mut tail = level;
        for bounce in 0..TIP_BOUNCES {
            sink.push([tip.x, tip.y, tip.z], bounce as f64 * TIP_BOUNCE_M, [tail, 0.0], true);
            tail *= TIP_BOUNCE_GAIN;
        }
        if self.side_lobes {
            sink.add_lobes(tip, level * amplitude_from_db(LOBE_LEVEL_DB));
        }
        for i in 0..FACET_POINTS {
            let [re, im] = self.noise(tape, u64::MAX - i as u64);
            let back_m = FACET_LENGTH_M * (i as f64 + 0.5) / FACET_POINTS as f64;
            let p = tip - axis * back_m;
            let level = level * FACET_GAIN / (FACET_POINTS as f64).sqrt();
            sink.push([p.x, p.y, p.z], 0.0, [level * f64::from(re), level * f64::from(im)], true);
        }
    }

    fn add_piece(&self, sink: &mut Sink, tape: &BakedTape, piece: &Piece) {
        let beam = sink.beam;
        let radius_m = self.spec.outer_diameter_m / 2.0;
        let a = piece.towards_tip;
        // The point of the wall nearest to the probe, and the steel's own directions across the shaft.
        let across = |v: Vector| (v - a * a.dot(&v)).try_normalize(1e-6);
        let up = across(Vector::new(0.0, 0.0, -1.0));
        let fallback = if a.x.abs() < 0.7 { Vector::x() } else { Vector::y() };
        let roll = across(piece.bevel).or_else(|| across(fallback));
        let (Some(up), Some(roll)) = (up.or(roll), roll) else { return };
        let side = a.cross(&roll);

        let middle = piece.end - a * (piece.length_m / 2.0);
        let sigma_e_m = beam.sigma_elevation_m(middle.z);
        if middle.y.abs() > REACH * sigma_e_m + piece.length_m + radius_m {
            return;
        }
        // Amplitude along the shaft falls as exp(−s²·q/2) from a pixel; its phase turns by 2k·a_z per metre. Taken at the focus
        // for all of a straight shaft: an echo that began in the midst of it would show its beginning.
        let q = (a.x / beam.sigma_lateral_m).powi(2)
            + (a.y / sigma_e_m).powi(2)
            + (a.z / beam.sigma_axial_m).powi(2);
        let turn = beam.two_k_rad_m * a.z;
        let specular = piece.gain * amplitude_from_db(self.spec.specular_level_db);
        let rough = piece.gain * amplitude_from_db(self.spec.rough_level_db);
        let sum = specular * libm::exp(-0.5 * turn * turn / q);
        let floor = (COHERENT_SHARE * rough).max(COHERENT_FLOOR);
        let coherent_echoes = (0..=COHERENT_REVERBERATIONS)
            .take_while(|&bounce| self.specular && sum * REVERBERATION_GAIN.powi(bounce as i32) > floor)
            .count();
        // Stated at normal incidence: the line's sum over the lateral beam, √(2π)·σ_l, is the level.
        let coherent_step = specular * self.step_m / (core::f64::consts::TAU.sqrt() * beam.sigma_lateral_m);
        // Power of independent points on a line: v/ds·√(π/q); so that the rms is the stated level.
        let per_point_m = self.step_m * ROUGH_STEPS as f64 / SECTORS as f64;
        let rough_step = rough * (per_point_m / ROUGH_MEAN_COS4 * (q / core::f64::consts::PI).sqrt()).sqrt();
        let shaft = Shaft::new(&self.spec);

        let beside = a.cross(&up);
        let arc = if coherent_echoes > 0 { arc(beam, radius_m * up.z.abs()) } else { Vec::new() };

        let first = (piece.behind_tip_m / self.step_m - 0.5).ceil().max(0.0) as u64;
        for i in first.. {
            let s_m = (i as f64 + 0.5) * self.step_m;
            if s_m >= piece.behind_tip_m + piece.length_m {
                break;
            }
            let centre = piece.end - a * (s_m - piece.behind_tip_m);
            let wall_m = shaft.wall_m(s_m);
            let ground = (s_m / shaft.bevel_m).min(1.0);
            if coherent_echoes > 0 {
                let entry = ((piece.total_m - s_m) / ENTRY_FADE_M).min(1.0);
                let fade = coherent_step * smooth(ground) * smooth(entry);
                for Facing { cos, sin, weight } in &arc {
                    let normal = up * *cos + beside * *sin;
                    let amplitude = weight.map(|part| fade * part);
                    self.add_with_tail(sink, centre + normal * wall_m, amplitude, coherent_echoes);
                }
            }
            let first_sector = (i % ROUGH_STEPS) as usize;
            for (sector, &[cos, sin]) in
                self.around.iter().enumerate().skip(first_sector).step_by(ROUGH_STEPS as usize)
            {
                let normal = roll * cos + side * sin;
                let facing = normal.dot(&up);
                if facing > ROUGH_MIN_COSINE {
                    let [re, im] = self.noise(tape, i * SECTORS as u64 + sector as u64);
                    let level = rough_step * facing * facing;
                    let amplitude = [level * f64::from(re), level * f64::from(im)];
                    self.add_with_tail(sink, centre + normal * wall_m, amplitude, 1 + ROUGH_REVERBERATIONS);
                }
            }
        }
    }

    /// `echoes` from a point of the wall: itself, then reverberations inside the steel, thickness·c/c_steel apart.
    fn add_with_tail(&self, sink: &mut Sink, at: Vector, [re, im]: [f64; 2], echoes: usize) {
        let beam = sink.beam;
        let tissue_m_s = beam.wavelength_m() * beam.centre_frequency_hz();
        let spacing_m = self.spec.outer_diameter_m * tissue_m_s / STEEL_SOUND_SPEED_M_S;
        let mut gain = 1.0;
        for bounce in 0..if self.reverberates { echoes } else { 1 } {
            let amplitude = [gain * re, gain * im];
            sink.push([at.x, at.y, at.z], bounce as f64 * spacing_m, amplitude, bounce > 0);
            gain *= REVERBERATION_GAIN;
        }
    }
}

/// A line along the wall: the direction it faces, counted from the one nearest to the probe, and its share of the echo.
struct Facing {
    cos: f64,
    sin: f64,
    weight: [f64; 2],
}

/// Lines of the wall that the aperture sees as mirrors, under a triangle as a tapered aperture has. Those aside lie
/// deeper; their shares are turned so that all together make an echo of one at the place nearest to the probe, which is
/// `height_m` above the shaft's middle.
fn arc(beam: &Beam, height_m: f64) -> Vec<Facing> {
    let cone_rad = libm::atan(beam.half_cone());
    let step_rad = cone_rad / f64::from(ARC_LINES + 1);
    let lines =
        (-ARC_LINES..=ARC_LINES).map(|i| (f64::from(i) * step_rad, f64::from(ARC_LINES + 1 - i.abs())));
    let turn = |angle: f64| beam.two_k_rad_m * height_m * (1.0 - libm::cos(angle));
    let [re, im] = lines.clone().fold([0.0; 2], |[re, im], (angle, weight)| {
        let (sin, cos) = libm::sincos(turn(angle));
        [re + weight * cos, im - weight * sin]
    });
    let power = re * re + im * im;
    let share = |weight: f64| [weight * re / power, -weight * im / power];
    lines
        .map(|(angle, weight)| {
            let (sin, cos) = libm::sincos(angle);
            Facing { cos, sin, weight: share(weight) }
        })
        .collect()
}

/// A straight piece of the shaft in the probe frame.
struct Piece {
    /// Its end towards the tip.
    end: Vector,
    towards_tip: Vector,
    bevel: Vector,
    /// Length of the path from `end` to the tip.
    behind_tip_m: f64,
    length_m: f64,
    total_m: f64,
    gain: f64,
}

fn smooth(u: f64) -> f64 {
    let u = u.clamp(0.0, 1.0);
    u * u * (3.0 - 2.0 * u)
}

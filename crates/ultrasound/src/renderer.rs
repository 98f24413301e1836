//! The stages in order.

use sonoloop_types::{
    Drag, Image, ImageGeometry, Indentation, NeedlePath, NeedleSpec, Pose, ProbeSpec, Slice, Tissue,
};

use crate::{
    awake,
    axial::{AxialScratch, BLOCK},
    beam::Beam,
    boundary,
    columns::Columns,
    display::{self, Display, Exposure},
    echo::Echo,
    elevation::ElevationTable,
    instructions::Instructions,
    jobs::Jobs,
    lateral::{BeamFilters, LateralFilters, LineMap},
    lattice::Lattice,
    motion::Motion,
    needle::{NeedleEchoes, Shaft},
    paths::{self, Paths, Plane},
    points::{self, Points},
    shear::Shear,
    splat::{Grid, Sources},
    stamp::{self, Layout, Stamps},
    tape::BakedTape,
    warp::Press,
};

/// Display rows per task; fixed, so that results do not depend on the number of threads.
const TASK_ROWS: usize = 120;

/// Makes the calling thread one of those that draw, for a program whose one thread asks for all pictures: nothing is handed
/// over, and it does not sleep meanwhile. To be called before anything is drawn; it changes nothing after that. Other
/// threads that draw wait for this one where it is the only one of its kind (a single core).
pub fn draw_on_this_thread() {
    let _ = rayon::ThreadPoolBuilder::new().use_current_thread().build_global();
}

/// Renders pictures of one needle in one phantom through one probe.
///
/// The model (probe, needle, tissue, scatterers) does not change after [`Renderer::new`]; what else it holds
/// is scratch, a cache of the tissue's columns and the field of the picture before, none of which shows in a
/// picture.
pub struct Renderer {
    instructions: Instructions,
    beam: Beam,
    lattice: Lattice,
    lateral: LateralFilters,
    display: Display,
    frame: Frame,
    columns: Columns,
    tape: BakedTape,
    elevation: ElevationTable,
    jobs: Jobs,
    points: Points,
    motion: Option<Motion>,
    grid: Grid,
    echoes: Echoes,
    paths: Paths,
    field: Vec<f32>,
    /// The field before echoes are stamped on it, made when tissue is as it was one picture before.
    resting: Vec<f32>,
    resting_is_made: bool,
    /// How display columns lie on `grid`, and how many rows it has; `None` when no tissue shows.
    map: Option<(LineMap, usize)>,
    /// What all of these were made for.
    made_for: Option<Scene>,
    scratch: Vec<AxialScratch>,
}

/// What is stamped on the field: the needle, and where materials meet.
struct Echoes {
    shaft: Shaft,
    needle: NeedleEchoes,
    surfaces: Vec<Echo>,
    stamps: Stamps,
}

impl Echoes {
    /// Makes the stamps, and the maps of the paths, once the tissue's surfaces and losses are known.
    fn stamp(
        &mut self,
        instructions: Instructions,
        beam: &Beam,
        tape: &BakedTape,
        paths: &mut Paths,
        slice: &Slice,
        layout: &Layout,
    ) {
        let Self { shaft, needle, surfaces, stamps } = self;
        awake::join(|| needle.build(beam, tape, slice), || paths.build(instructions, beam, slice, shaft));
        stamp::prepare(instructions, stamps, beam, paths, [&*needle.echoes, surfaces], layout);
    }
}

/// What of the field is made anew.
#[derive(Clone, Copy)]
enum Redo {
    Nothing,
    All,
    /// What is stamped on it; the tissue's part as well when `rest`.
    Echoes {
        rest: bool,
    },
}

/// What the tissue's part of the field depends on.
#[derive(Clone, PartialEq)]
struct Pressed {
    phantom_from_probe: Pose,
    indentation: Option<Indentation>,
    drag: Option<Drag>,
}

/// What the field depends on.
#[derive(Clone, PartialEq)]
struct Scene {
    tissue: Pressed,
    needle: Option<NeedlePath>,
    needle_gain_db: f64,
    element_gap_m: Vec<f32>,
    element_loss_db: Vec<f32>,
}

impl Scene {
    fn of(slice: &Slice) -> Self {
        Self {
            tissue: Pressed {
                phantom_from_probe: slice.phantom_from_probe,
                indentation: slice.indentation,
                drag: slice.drag,
            },
            needle: slice.needle.clone(),
            needle_gain_db: slice.needle_gain_db,
            element_gap_m: slice.element_gap_m.clone(),
            element_loss_db: slice.element_loss_db.clone(),
        }
    }
}

/// Which part of the picture the array covers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Frame {
    pub geometry: ImageGeometry,
    /// First displayed column of the image, and how many there are.
    pub first_px: usize,
    pub columns: usize,
    /// The same, padded to whole blocks.
    pub padded: usize,
    /// x of the first displayed column.
    pub first_x_m: f64,
}

impl Frame {
    pub fn new(probe: &ProbeSpec) -> Self {
        let geometry = probe.geometry;
        let centre_px = geometry.centre_column_px();
        let half_px = probe.aperture_m() / 2.0 / geometry.spacing_m;
        let first_px = (centre_px - half_px).ceil().max(0.0) as usize;
        let end_px = ((centre_px + half_px).floor() as usize + 1).min(geometry.width_px as usize);
        let columns = end_px.saturating_sub(first_px);
        Self {
            geometry,
            first_px,
            columns,
            padded: columns.next_multiple_of(BLOCK),
            first_x_m: (first_px as f64 - centre_px) * geometry.spacing_m,
        }
    }

    /// What paths are traced through.
    pub fn plane(&self) -> Plane {
        let Self { geometry, columns, first_x_m, .. } = *self;
        Plane { columns, rows: self.rows(), first_x_m, spacing_m: geometry.spacing_m }
    }

    pub fn rows(&self) -> usize {
        self.geometry.height_px as usize
    }

    pub fn deepest_m(&self) -> f64 {
        f64::from(self.geometry.height_px.saturating_sub(1)) * self.geometry.spacing_m
    }
}

/// The complex baseband field at the displayed pixels, in units of unit-backscatter speckle's rms, before
/// attenuation, contact, noise and compensation.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// Column of the image that column 0 of the field is.
    pub first_px: usize,
    /// Columns of the field.
    pub columns: usize,
    /// Rows of the field, as many as the image's.
    pub rows: usize,
    /// Real and imaginary parts, row by row.
    pub values: Vec<[f32; 2]>,
}

impl Renderer {
    /// Prepares to render. `seed` picks the scatterers, the needle's roughness and the electronic noise; the
    /// probe and needle are taken as checked (positive sizes, elevation table not empty).
    pub fn new(probe: ProbeSpec, needle: NeedleSpec, tissue: Tissue, seed: u64) -> Self {
        let beam = Beam::new(&probe);
        let lattice = Lattice::new(&beam, seed);
        let frame = Frame::new(&probe);
        let half_width_m = -frame.first_x_m;
        let spacing_m = frame.geometry.spacing_m;
        Self {
            instructions: Instructions::widest(),
            lateral: LateralFilters::new(&beam, spacing_m, half_width_m, frame.deepest_m(), frame.padded),
            display: Display::new(&beam, &probe, seed),
            columns: Columns::new(tissue, lattice, &probe),
            tape: BakedTape::new(seed),
            elevation: ElevationTable::default(),
            jobs: Jobs::default(),
            points: Points::default(),
            motion: None,
            grid: Grid::default(),
            echoes: Echoes {
                shaft: Shaft::new(&needle),
                needle: NeedleEchoes::new(&needle, &beam, &probe, seed),
                surfaces: Vec::new(),
                stamps: Stamps::default(),
            },
            paths: Paths::new(&beam, &probe, frame.plane()),
            field: vec![0.0; frame.rows() * 2 * frame.padded],
            resting: vec![0.0; frame.rows() * 2 * frame.padded],
            resting_is_made: false,
            map: None,
            made_for: None,
            scratch: Vec::new(),
            beam,
            lattice,
            frame,
        }
    }

    /// Takes other instructions than the widest of this CPU; pictures are the same, byte by byte.
    pub fn use_instructions(&mut self, instructions: Instructions) {
        self.instructions = instructions;
        self.made_for = None;
    }

    /// Draws the slice into `image`, which takes the probe's picture size. The same slice gives the same
    /// bytes for any number of threads of the current rayon pool and any earlier pictures.
    pub fn render(&mut self, slice: &Slice, image: &mut Image) {
        let Frame { geometry, first_px, columns, padded, .. } = self.frame;
        if (image.width_px, image.height_px) != (geometry.width_px, geometry.height_px) {
            *image = Image::black(geometry.width_px, geometry.height_px);
        }
        let spacing_m = geometry.spacing_m;
        let exposure = Exposure::new(slice, spacing_m);
        // Entered once: every hand-over from a thread outside the pool would put that thread to sleep.
        rayon::scope(|_| {
            self.fill_field(slice, &mut image.pixels, |this, row, field, pixels| {
                let (re, im) = field.split_at(padded);
                pixels.fill(0);
                let pixels = &mut pixels[first_px..][..columns];
                let Finish { instructions, display, paths } = *this;
                display::draw_row(instructions, display, &exposure, paths, row, (re, im), pixels);
            });
        });
    }

    /// The complex field behind the picture, see [`Field`].
    pub fn field(&mut self, slice: &Slice) -> Field {
        let Frame { geometry, first_px, columns, padded, .. } = self.frame;
        let mut image = Image::black(geometry.width_px, geometry.height_px);
        rayon::scope(|_| self.fill_field(slice, &mut image.pixels, |_, _, _, _| {}));
        let values = self.field.chunks_exact(2 * padded).flat_map(|row| {
            let (re, im) = row.split_at(padded);
            re[..columns].iter().zip(&im[..columns]).map(|(&re, &im)| [re, im])
        });
        Field { first_px, columns, rows: self.frame.rows(), values: values.collect() }
    }

    /// Fills `self.field`, unless it is that of the slice already, and hands every row, with the picture's, to
    /// `finish`.
    fn fill_field(
        &mut self,
        slice: &Slice,
        pixels: &mut [u8],
        finish: impl Fn(&Finish, usize, &[f32], &mut [u8]) + Sync,
    ) {
        let Frame { geometry, columns, padded, first_x_m, .. } = self.frame;
        let width = geometry.width_px as usize;
        if columns == 0 {
            pixels.fill(0);
            return;
        }
        let spacing_m = geometry.spacing_m;
        let layout = Layout { columns: padded, rows: self.frame.rows(), first_x_m, spacing_m };
        let scene = Scene::of(slice);
        let redo = if self.made_for.as_ref() == Some(&scene) {
            Redo::Nothing
        } else if self.made_for.as_ref().map(|before| &before.tissue) != Some(&scene.tissue) {
            self.map = self.fill_grid(slice, &layout);
            self.resting_is_made = false;
            Redo::All
        } else {
            let Self { instructions, echoes, beam, tape, paths, .. } = self;
            echoes.stamp(*instructions, beam, tape, paths, slice, &layout);
            Redo::Echoes { rest: !core::mem::replace(&mut self.resting_is_made, true) }
        };
        self.made_for = Some(scene);

        let tasks = self.frame.rows().div_ceil(TASK_ROWS);
        self.scratch.resize_with(tasks, AxialScratch::default);
        let (beam, paths, lateral) = (&self.beam, &self.paths, &self.lateral);
        let (grid, stamps) = (&self.grid, &self.echoes.stamps);
        let instructions = self.instructions;
        let filters =
            self.map.map(|(map, rows)| BeamFilters { instructions, beam, paths, lateral, grid, map, rows });
        let this = Finish { instructions, display: &self.display, paths };
        let parts = self
            .field
            .chunks_mut(TASK_ROWS * 2 * padded)
            .zip(self.resting.chunks_mut(TASK_ROWS * 2 * padded))
            .zip(pixels.chunks_mut(TASK_ROWS * width))
            .zip(&mut self.scratch)
            .enumerate();
        awake::for_each(parts, |(task, (((field, resting), pixels), scratch))| {
            let first_row = task * TASK_ROWS;
            let mut filter = |field: &mut [f32]| match &filters {
                Some(filters) => scratch.display_rows(filters, padded, spacing_m, first_row, field),
                None => field.fill(0.0),
            };
            match redo {
                Redo::Nothing => {}
                Redo::All => filter(field),
                Redo::Echoes { rest } => {
                    if rest {
                        filter(resting);
                    }
                    field.copy_from_slice(resting);
                }
            }
            if !matches!(redo, Redo::Nothing) {
                stamp::apply(instructions, stamps, padded, first_row, field);
            }
            let rows = field.chunks_exact(2 * padded).zip(pixels.chunks_exact_mut(width));
            for (i, (field, pixels)) in rows.enumerate() {
                finish(&this, first_row + i, field, pixels);
            }
        });
    }

    /// Fills the working grid, the stamps and the losses; `None` when the pose shows no tissue.
    fn fill_grid(&mut self, slice: &Slice, layout: &Layout) -> Option<(LineMap, usize)> {
        let Frame { geometry, first_x_m, .. } = self.frame;
        let spacing_m = geometry.spacing_m;
        let line_pitch_m = spacing_m / self.beam.grain.lines_per_px as f64;
        // Beside the picture lie what the beam reaches, and the last knot of the paths.
        let knot = (paths::ACROSS + 1) * self.beam.grain.lines_per_px;
        let margin_m = (self.lateral.radius + 2).max(knot) as f64 * line_pitch_m;
        let instructions = self.instructions;
        let Self { beam, lattice, tape, elevation, columns: tissue, motion, .. } = self;
        let (beam, lattice) = (&*beam, &*lattice);
        let (indentation, drag) =
            (slice.indentation.filter(Indentation::is_sound), slice.drag.filter(Drag::is_sound));
        match motion {
            _ if indentation.is_none() && drag.is_none() => *motion = None,
            Some(motion) => motion.set(indentation.as_ref(), drag),
            None => *motion = Some(Motion::new(indentation.as_ref(), drag)),
        }
        let motion = motion.as_ref();
        let shear = Shear::new(
            &slice.phantom_from_probe,
            beam,
            lattice,
            &geometry,
            -first_x_m + margin_m,
            motion,
            tissue.half(),
        );
        let shear = shear.as_ref();
        if let Some(shear) = shear {
            elevation.build(instructions, beam, shear, lattice.amplitude());
            tape.bake(beam, shear);
            let (scattering, mirroring) = (
                points::slab(elevation, shear.thinning.classes - 1, motion),
                boundary::slab(lattice, shear, motion),
            );
            for iy in shear.rows_across() {
                tissue.learn(shear.overlap(scattering, iy), iy);
                tissue.learn_facets(shear.overlap(mirroring, iy), iy);
            }
        }
        let Self { jobs, points, grid, echoes, paths, .. } = self;
        if let (Some(shear), Some(motion)) = (shear, motion) {
            let press = Press { beam, lattice, phantom_from_probe: &slice.phantom_from_probe, motion };
            let classes = points.lay(instructions, &press, shear, elevation);
            tape.strain(instructions, beam, classes);
        }
        if shear.is_some() && motion.is_none() {
            tape.rest(instructions);
        }
        let (tape, elevation, tissue, pose) = (&*tape, &*elevation, &*tissue, &slice.phantom_from_probe);
        // The grid's tasks are there for whoever is done first.
        awake::join(
            || {
                let Some(shear) = shear else { return };
                if let Some(motion) = motion {
                    let model = points::Model { instructions, beam, tape, elevation, shear };
                    points.fill(model, lattice, tissue, pose, motion, grid);
                } else {
                    let phase_per_row_rad = beam.two_k_rad_m * shear.row_step_m;
                    let sources = Sources { instructions, tape, elevation, columns: tissue };
                    jobs.build(shear, lattice, sources, phase_per_row_rad);
                    grid.fill(shear, jobs, sources);
                }
            },
            || {
                echoes.surfaces.clear();
                // A pose that shows no tissue has none in the way either.
                paths.sample(instructions, lattice, tissue, shear.map(|_| pose), motion);
                if let Some(shear) = shear {
                    boundary::add_echoes(
                        instructions,
                        beam,
                        lattice,
                        shear,
                        tissue,
                        slice,
                        motion,
                        &mut echoes.surfaces,
                    );
                }
                echoes.stamp(instructions, beam, tape, paths, slice, layout);
            },
        );
        let shear = shear?;
        let map = LineMap {
            at_row_0: (first_x_m - shear.first_line_m) / line_pitch_m,
            per_row: -shear.lateral_slope * shear.row_step_m / line_pitch_m,
            row_step_m: shear.row_step_m,
        };
        Some((map, shear.rows))
    }
}

/// What a finished row needs.
struct Finish<'a> {
    instructions: Instructions,
    display: &'a Display,
    paths: &'a Paths,
}

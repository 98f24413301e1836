//! Slice → Image: B-mode pictures with honest speckle.
//!
//! # Model
//!
//! Scatterers sit on a lattice fixed in the phantom, each with a complex Gaussian amplitude, so the field of
//! any beam is Rayleigh and moves with the tissue. Where the slice is thick some are left out, and the others stronger by as
//! much power (`thinning`). A scatterer at (x, e, z) of the probe frame adds
//!
//! `a · w(e; z) · L(u − x) · P(v − z) · exp(−i·2k·z)`
//!
//! to the baseband field at the pixel whose centre is (u, v), with Gaussian elevational, lateral and axial
//! profiles that all act on the two-way *amplitude*: σ is the −6 dB amplitude width over 2.355. Each profile is
//! scaled to unit energy, which is what an equalised scanner shows: speckle of unit backscatter has rms 1 at
//! every depth before attenuation, and a small target stands out more where the slice is thin.
//!
//! # Stages
//!
//! [`Renderer`] runs them in this order; the fast path is the *shear-column splat*. The working grid is laid
//! along the phantom's columns: lines one pixel apart, sheared with the tilt, rows one lattice step apart.
//! Along a column the line fraction, the depth fraction and the phase are then constant, and a column is one
//! multiply-add of a shared noise tape into two lines. Where a probe presses ([`sonoloop_types::Indentation`]) or a
//! needle's tip drags ([`sonoloop_types::Drag`]) columns bend: on rows that follow the tissue eight scatterers at a time are
//! nearly straight and are added as straight columns are, and scatterers one by one where they are not.
//!
//! | file | does |
//! |---|---|
//! | `beam` | widths, wavelength, units of amplitude |
//! | `lens` | how pulse and beam widen out of the lens's focus |
//! | `lattice`, `columns`, `table` | scatterers of the phantom; materials along a column, cached |
//! | `thinning` | fewer and stronger columns where the slice is thick |
//! | `tape` | the noise tape, with carrier and sub-row delays of one tilt |
//! | `shear` | working grid of one pose |
//! | `elevation` | weights by elevation and row |
//! | `jobs`, `splat` | which stretch of tape goes where; adding it |
//! | `awake`, `per_thread` | work for the pool's threads, and their scratch |
//! | `motion`, `warp` | where pressed tissue is; rows that follow it |
//! | `points`, `strides`, `block` | which of its columns show, and where; adding them stride by stride |
//! | `lateral`, `axial` | dual beam filter per row; pulse onto the display rows |
//! | `needle` | echoes of the steel: shaft, tip, their repeats and side lobes |
//! | `boundary` | mirrors where materials meet |
//! | `echo`, `stamp` | points that echo; their exact point spread added to the field |
//! | `march`, `paths` | loss and delay along the aperture's directions; maps of both, and of frequency |
//! | `contact`, `occlusion` | blind elements; steel in the way |
//! | `display` | noise, compensation, logarithm, grey levels |
//! | `fast` | exponential, logarithm, rounding |
//! | [`reference`](mod@reference) | the same field by direct summation, slow, for tests |
//!
//! # What sound meets
//!
//! A place is seen through a cone of depth over F#, cut into a few directions. Transmission and delay are marched down
//! along each; their mean over the aperture gives two-way amplitude (so shadows have a penumbra and fill with depth),
//! the depth at which an echo is drawn by the assumed sound speed, and the fall of the centre frequency, which
//! widens the beam laterally and spares the pulse some loss. Surfaces between materials reflect as mirrors, by
//! impedance and angle, and weakly as rough ones. Every effect can be switched off:
//! [`Effects`](sonoloop_types::Effects).
//!
//! # Left out
//!
//! Sound speed and loss move with tissue by whole columns.
//! Through other sound speeds a pulse keeps its carrier as drawn: the field is some 12 % off the sum over its scatterers
//! there, not 5 %. The uppermost 15 mm taken alone are 4.2 to 5.2 % off, which deeper pictures make up for. In the first half millimetre scatterers above the face are missing, and the picture's top row is dark.
//! In the fine mode the tapes of strained tissue take 1.2 MB for every half per cent of strain that a picture has.
//! Where pixels are coarser than the pulse (a picture 120 mm deep) the envelope is sampled, not averaged, and thin bright
//! surfaces flicker as they pass from row to row.
//!
//! Paths are straight: nothing refracts, and the beam keeps its focus behind other sound speeds. The slice's thickness does
//! not grow as the frequency falls. Delays are bounded by 2.5 mm, and lines whose pulses together span more than 64 rows of
//! the working grid lose part of theirs. A row is 1.15 σ of the pulse upright: that is a difference of 4 mm at 7.5 MHz and
//! 2 mm at 15, under air and metal, where there is shadow anyway. The map of shadows blurs their edges, by a millimetre
//! 20 mm farther down. Only the tip has side lobes. Blind elements dim the lines but do not widen the beam. Tissue is not
//! drawn for a probe tilted by more than 60° out of the phantom's vertical.

mod awake;
mod axial;
mod beam;
mod block;
mod boundary;
mod columns;
mod contact;
mod display;
mod echo;
mod elevation;
mod fast;
mod jobs;
mod lateral;
mod lattice;
mod lens;
mod march;
mod motion;
mod needle;
mod occlusion;
mod paths;
mod per_thread;
mod points;
pub mod reference;
mod renderer;
mod shear;
mod splat;
mod stamp;
mod strides;
mod table;
mod tape;
mod thinning;
mod warp;

pub use renderer::{Field, Renderer, draw_on_this_thread};
use sonoloop_simd as instructions;
pub use sonoloop_simd::Instructions;

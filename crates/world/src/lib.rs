//! Phantom, needle, arm, contact and disturbances: `Command → Slice + truth`.
//!
//! [`World`] advances in ticks of one millisecond. It holds two versions of everything that a real rig
//! cannot know exactly: what is true, which goes into [`Slice`](sonoloop_types::Slice) and
//! [`Truth`](sonoloop_types::Truth), and what is measured, which goes into
//! [`Setup`](sonoloop_types::Setup) and [`Acquisition`](sonoloop_types::Acquisition). The difference is drawn
//! from the scenario's seed, and grows when the probe slips in its holder.
//!
//! | module | holds |
//! |---|---|
//! | `chain`, `ik`, `motion`, `arm` | joints of the URDF, inverse kinematics, jerk-limited motion, set point and status |
//! | `contact`, `punch`, `press` | flat punch on gel, how the tissue gives way, force control along the probe's axis |
//! | `needle_path`, `needle_feed` | arcs of the tip through the materials; how fast it is fed |
//! | `needle_force` | faces, friction, bone: force on the needle, tissue that it carries along |
//! | `hand`, `sway` | a hand in its place: speed, pauses, reaction to cues; the shaft that it turns in tissue |
//! | `needle_robot` | joints of the robot that holds the needle |
//! | `phantom` | which material lies where, for the needle and for the renderer |
//! | `scene` | rapier bodies: who comes too near to whom |
//! | `hidden`, `placement`, `model` | errors drawn from the seed, the operator's placement, checks before the start |
//! | `timeline`, `phantom_motion`, `inbox` | disturbances, commands on their way |
//! | `truth`, `world` | visibility, the tick itself |
//!
//! Limits of this version: pressed tissue does not bend the needle, the phantom moves without turning, and the shaft lies
//! in the swept path of the tip.
//! Housing, table and the constants of contact are assumed; each says so where it stands.

mod arm;
mod chain;
mod contact;
mod error;
#[cfg(test)]
mod fixture;
mod hand;
mod hidden;
mod ik;
mod inbox;
mod model;
mod motion;
mod needle_feed;
mod needle_force;
mod needle_path;
mod needle_robot;
mod phantom;
mod phantom_motion;
mod placement;
mod press;
mod punch;
mod scene;
mod sway;
mod timeline;
mod truth;
mod world;

pub use error::WorldError;
pub use hidden::GarbageWords;
pub use ik::Unreachable;
pub use model::PROTOCOL;
pub use phantom::tissue;
pub use world::World;

use serde::{Deserialize, Serialize};

/// What kind of thing happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EventKind {
    /// A scripted disturbance began.
    Disturbance,
    /// The tracker's state changed.
    StateChange,
    /// A command was refused.
    CommandRefused,
    /// The needle robot stopped by itself: no valid command for too long.
    Watchdog,
    /// The needle came to rest.
    NeedleStopped,
    /// The needle moves again.
    NeedleResumed,
    /// The tip pierced a face that it had pushed ahead.
    Puncture,
    /// The force on the needle exceeded what its robot allows: it stops for good.
    NeedleBlocked,
    /// A collision began.
    Collision,
    /// The contact force exceeded its limit.
    ForceLimit,
    /// A target of the arm lies outside what it can reach.
    Unreachable,
    /// The tracker was killed by the scenario.
    TrackerKilled,
    /// The tracker is back.
    TrackerRestarted,
    /// An observer asked for something.
    Control,
    /// The run ended.
    End,
}

/// One line of `events.csv`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Event {
    /// Simulated time.
    pub tick: u64,
    /// What kind of thing.
    pub kind: EventKind,
    /// One short sentence; deterministic.
    pub detail: String,
}

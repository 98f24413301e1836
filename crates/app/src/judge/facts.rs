use sonoloop_scenario::{Bound, DisturbanceKind, Scenario};
use sonoloop_types::{ImageGeometry, TICKS_PER_SECOND};

/// Silent loss that a success allows when the scenario bounds none.
const DEFAULT_SILENT_LOSS_S: f64 = 0.5;

/// A stop takes effect within this after the command's delay.
const STOP_TICKS: u64 = 40;

/// What the metrics need to know of the experiment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Facts {
    /// Picture layout; its spacing turns pixels into metres.
    pub geometry: ImageGeometry,
    /// Ticks between images.
    pub image_period_ticks: u64,
    /// Success: the tip ends within this distance of the target.
    pub target_tolerance_m: f64,
    /// Success: the contact force never exceeds this.
    pub max_contact_force_n: f64,
    /// Success: silent loss at most this long.
    pub silent_loss_bound_s: f64,
    /// Success: after a declared loss the needle stands at the latest after this.
    pub stop_bound_s: f64,
}

impl Facts {
    /// The facts of a scenario. Its own `expect` bound on `silent_loss_s` counts, else 0.5 s.
    pub fn of(scenario: &Scenario) -> Self {
        let bounded = scenario.expect.iter().find_map(|expectation| match expectation.bound {
            Bound::Range { max: Some(max), .. } if expectation.metric == "silent_loss_s" => Some(max),
            _ => None,
        });
        Self {
            geometry: scenario.probe.geometry,
            image_period_ticks: scenario.image_period_ticks,
            target_tolerance_m: scenario.insertion.target_tolerance_m,
            max_contact_force_n: scenario.limits.max_contact_force_n,
            silent_loss_bound_s: bounded.unwrap_or(DEFAULT_SILENT_LOSS_S),
            stop_bound_s: stop_bound_s(scenario),
        }
    }
}

/// The contract's: the longest delay of a command, 40 ms, and the needle robot's deceleration from its fastest feed; with a
/// hand its slowest reaction and half a second, in which it has long come to rest.
fn stop_bound_s(scenario: &Scenario) -> f64 {
    let scripted = scenario.disturbances.iter().filter_map(|disturbance| match disturbance.kind {
        DisturbanceKind::CommandDelay { command_ticks } => Some(command_ticks),
        _ => None,
    });
    let delay_ticks = scripted.fold(scenario.delays.command_ticks, u64::max);
    if let Some(hand) = scenario.insertion.hand {
        let ticks = delay_ticks + STOP_TICKS + hand.reaction_ticks[1];
        return ticks as f64 / TICKS_PER_SECOND as f64 + 0.5;
    }
    let robot = &scenario.needle_robot;
    let ticks = delay_ticks + STOP_TICKS;
    ticks as f64 / TICKS_PER_SECOND as f64 + robot.max_feed_m_s / robot.max_acceleration_m_s2
}

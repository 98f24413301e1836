//! A hand that inserts the needle in place of the robot: how fast it pushes, when it pauses, how it sways.
//!
//! What is asked of it is a cue on a screen, go or stop and near the target how slow: it acts on what was asked a reaction
//! time ago, and its own speed is scaled by that share of the full feed. When the hub sways the needle turns at its entry
//! ([`crate::sway`]). All figures are the scenario's; the laws are assumed: sums of sines (speed 0.2 to 1 Hz, sway 0.1 to
//! 0.5 Hz, tremor 8 to 12 Hz).

use std::collections::VecDeque;

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use sonoloop_scenario::HandSpec;
use sonoloop_types::{TICKS_PER_SECOND, Vector};

use crate::hidden::{Stream, generator};

/// How fast a hand gets under way and stops. Assumed.
pub(crate) const MAX_ACCELERATION_M_S2: f64 = 0.1;
/// A hand feels bone and lets off at this force. Assumed.
pub(crate) const MAX_FORCE_N: f64 = 5.0;
/// The hub is held at least this far from the entry.
const LEAST_LEVER_M: f64 = 20e-3;
/// The operator has aligned the probe with a needle at rest; within so long the hand begins to sway.
const ONSET_S: f64 = 1.0;

/// Several sines of the same weight, within ±1 together.
#[derive(Debug, Clone, Copy)]
struct Waves<const N: usize>([(f64, f64); N]);

impl<const N: usize> Waves<N> {
    fn draw(rng: &mut ChaCha8Rng, [low_hz, high_hz]: [f64; 2]) -> Self {
        Self(std::array::from_fn(|_| {
            let hz = between(rng, [low_hz, high_hz]);
            (std::f64::consts::TAU * hz, between(rng, [0.0, std::f64::consts::TAU]))
        }))
    }

    fn at(&self, time_s: f64) -> f64 {
        self.0.iter().map(|(rad_s, phase)| libm::sin(rad_s * time_s + phase)).sum::<f64>() / N as f64
    }
}

/// The unchanging part, drawn from the seed.
#[derive(Debug, Clone)]
pub(crate) struct Hand {
    spec: HandSpec,
    seed: u64,
    /// What is asked where nothing calls for less.
    full_feed_m_s: f64,
    speed: Waves<3>,
    /// First tick of each pause and the first after it.
    pauses: Vec<[u64; 2]>,
    /// About the two axes across the needle.
    swing: [Waves<2>; 2],
    tremor: [Waves<1>; 2],
}

/// What the hand has seen of the cues.
#[derive(Debug, Clone, Default)]
pub(crate) struct Attention {
    /// What was asked, and from which tick; the first entry is what the hand acts on.
    asked: VecDeque<(u64, f64)>,
    reaction_ticks: u64,
    /// Turns from stop to go and back.
    cues: u64,
}

impl Hand {
    pub(crate) fn draw(seed: u64, spec: &HandSpec, full_feed_m_s: f64, duration_ticks: u64) -> Self {
        let mut rng = generator(seed, Stream::Hand);
        let speed = Waves::draw(&mut rng, [0.2, 1.0]);
        let swing = [0, 1].map(|_| Waves::draw(&mut rng, [0.1, 0.5]));
        let tremor = [0, 1].map(|_| Waves::draw(&mut rng, [8.0, 12.0]));
        let mut pauses = Vec::new();
        let ticks = |seconds: f64| (seconds * TICKS_PER_SECOND as f64) as u64;
        let mut tick = 0;
        while tick < duration_ticks {
            let begins = tick + ticks(between(&mut rng, spec.pause_every_s)).max(1);
            tick = begins + ticks(between(&mut rng, spec.pause_s));
            pauses.push([begins, tick]);
        }
        Self { spec: *spec, seed, full_feed_m_s, speed, pauses, swing, tremor }
    }

    /// Its fastest.
    pub(crate) fn max_speed_m_s(&self) -> f64 {
        self.spec.speed_m_s[1]
    }

    /// The speed at which it would push by itself.
    fn own_speed_m_s(&self, tick: u64) -> f64 {
        let index = self.pauses.partition_point(|[begins, _]| *begins <= tick);
        if index > 0 && tick < self.pauses[index - 1][1] {
            return 0.0;
        }
        let [low, high] = self.spec.speed_m_s;
        0.5 * (low + high) + 0.5 * (high - low) * self.speed.at(seconds(tick))
    }

    fn reaction_ticks(&self, cue: u64) -> u64 {
        let mut rng = generator(self.seed, Stream::Reaction);
        rng.set_word_pos(u128::from(cue) * 2);
        let [low, high] = self.spec.reaction_ticks;
        low + (unit(&mut rng) * (high - low + 1) as f64) as u64
    }

    /// Turn of the needle at its entry, axis times angle, for a hub that is `lever_m` from the entry along the unit vector
    /// `axis`.
    pub(crate) fn turn(&self, tick: u64, axis: &Vector, lever_m: f64) -> Vector {
        let time_s = seconds(tick);
        let onset = (time_s / ONSET_S).min(1.0);
        let [u, v] = [0, 1].map(|i| {
            onset
                * (self.spec.swing_m * self.swing[i].at(time_s)
                    + self.spec.tremor_m * self.tremor[i].at(time_s))
        });
        let across = axis.cross(&if axis.z.abs() < 0.9 { Vector::z() } else { Vector::x() }).normalize();
        let hub = across * u + axis.cross(&across) * v;
        // The hub is at −lever·axis: turned by θ it moves by θ × (−lever·axis), which is `hub` for θ = hub × axis/lever.
        hub.cross(axis) / lever_m.max(LEAST_LEVER_M)
    }
}

impl Attention {
    /// Speed at which the hand wants to push at `tick`, with `asked_m_s` on the screen since this tick.
    pub(crate) fn speed_m_s(&mut self, hand: &Hand, tick: u64, asked_m_s: f64) -> f64 {
        let before_m_s = self.asked.back().map_or(0.0, |(_, asked_m_s)| *asked_m_s);
        if asked_m_s != before_m_s {
            if (asked_m_s > 0.0) != (before_m_s > 0.0) {
                self.reaction_ticks = hand.reaction_ticks(self.cues);
                self.cues += 1;
            }
            if self.asked.is_empty() {
                self.asked.push_back((0, 0.0));
            }
            self.asked.push_back((tick, asked_m_s));
        }
        while self.asked.get(1).is_some_and(|(since, _)| since + self.reaction_ticks <= tick) {
            self.asked.pop_front();
        }
        let seen_m_s = self.asked.front().map_or(0.0, |(_, asked_m_s)| *asked_m_s);
        hand.own_speed_m_s(tick) * (seen_m_s / hand.full_feed_m_s).clamp(0.0, 1.0)
    }
}

fn seconds(tick: u64) -> f64 {
    tick as f64 / TICKS_PER_SECOND as f64
}

/// Evenly in [0, 1).
fn unit(rng: &mut ChaCha8Rng) -> f64 {
    (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

fn between(rng: &mut ChaCha8Rng, [low, high]: [f64; 2]) -> f64 {
    low + (high - low) * unit(rng)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    const FULL_M_S: f64 = 0.01;

    fn hand(seed: u64) -> Hand {
        Hand::draw(seed, &fixture::hand(), FULL_M_S, 60_000)
    }

    #[test]
    fn its_speed_keeps_its_range_and_pauses_are_as_long_and_as_seldom_as_told() {
        for seed in 0..20 {
            let (hand, spec) = (hand(seed), fixture::hand());
            let speeds: Vec<f64> = (0..60_000).map(|tick| hand.own_speed_m_s(tick)).collect();
            let moving = speeds.iter().filter(|speed| **speed > 0.0);
            assert!(moving.clone().all(|speed| (spec.speed_m_s[0]..=spec.speed_m_s[1]).contains(speed)));
            let (least, most) = moving.fold((f64::MAX, 0.0f64), |(low, high), s| (low.min(*s), high.max(*s)));
            assert!(most - least > 0.4 * (spec.speed_m_s[1] - spec.speed_m_s[0]), "{least} {most}");
            let mut before = 0;
            for [begins, ends] in &hand.pauses {
                let [pushed_s, paused_s] = [begins - before, ends - begins].map(seconds);
                // Whole ticks, rounded down.
                assert!(pushed_s > spec.pause_every_s[0] - 1e-3 && pushed_s <= spec.pause_every_s[1]);
                assert!(paused_s > spec.pause_s[0] - 1e-3 && paused_s <= spec.pause_s[1]);
                before = *ends;
            }
        }
    }

    #[test]
    fn every_cue_is_obeyed_after_its_own_reaction_time() {
        let mut seen = std::collections::BTreeSet::new();
        for seed in 0..20 {
            let mut spec = fixture::hand();
            spec.pause_every_s = [100.0; 2];
            let hand = Hand::draw(seed, &spec, FULL_M_S, 60_000);
            let mut attention = Attention::default();
            let mut was_pushing = false;
            let mut turns = Vec::new();
            for tick in 1..8000 {
                let asked_m_s = if (tick / 1000) % 2 == 1 { FULL_M_S } else { 0.0 };
                let pushing = attention.speed_m_s(&hand, tick, asked_m_s) > 0.0;
                if pushing != was_pushing {
                    turns.push(tick % 1000);
                }
                was_pushing = pushing;
            }
            assert_eq!(turns.len(), 7, "seed {seed}");
            assert!(turns.iter().all(|late| (300..=600).contains(late)), "{turns:?}");
            seen.extend(turns);
        }
        assert!(
            seen.first().is_some_and(|least| *least < 320) && seen.last().is_some_and(|most| *most > 580)
        );
    }

    #[test]
    fn half_of_the_feed_asked_is_half_of_its_speed() {
        let hand = hand(3);
        let mut attention = Attention::default();
        for tick in 0..1000 {
            attention.speed_m_s(&hand, tick, 0.5 * FULL_M_S);
        }
        assert_eq!(attention.speed_m_s(&hand, 1000, 0.5 * FULL_M_S), 0.5 * hand.own_speed_m_s(1000));
        assert_eq!(attention.speed_m_s(&hand, 1001, 0.5 * FULL_M_S), 0.5 * hand.own_speed_m_s(1001));
    }

    #[test]
    fn truth_the_hub_sways_as_told() {
        let (hand, spec) = (hand(5), fixture::hand());
        let axis = Vector::new(0.6, 0.0, -0.8);
        let lever_m = 0.1;
        let mut most_m = 0.0f64;
        for tick in (0..20_000).step_by(7) {
            let turn = hand.turn(tick, &axis, lever_m);
            assert!(turn.dot(&axis).abs() < 1e-15, "it does not twist");
            // Each axis within swing and tremor.
            let hub_m = turn.cross(&(axis * -lever_m)).norm();
            assert!(hub_m <= 1.42 * (spec.swing_m + spec.tremor_m));
            most_m = most_m.max(hub_m);
        }
        assert!(most_m > 0.5 * spec.swing_m, "{most_m}");
        assert_eq!(hand.turn(0, &axis, lever_m), Vector::zeros());
    }
}

//! Commands on their way to the robots: checked when they arrive, in force when they are due.

use std::collections::VecDeque;

use sonoloop_types::{Acquisition, Command, CommandReceipt, Limits, Pose, Refusal};

/// Ticks that a command may be older than the scripted delays.
const GRACE_TICKS: u64 = 200;
/// So many published images are remembered: 2.5 s at 25 Hz.
const REMEMBERED_IMAGES: usize = 64;
/// A rotation from the wire may be off unit length by rounding, no more.
const UNIT_TOLERANCE: f64 = 1e-6;

#[derive(Debug, Clone, Copy)]
struct Published {
    sequence: u64,
    acquisition_tick: u64,
    publication_tick: u64,
}

/// A command on its way to the robots.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pending {
    due_tick: u64,
    /// When the image that it answers was taken.
    pub image_tick: u64,
    pub command: Command,
}

/// Commands accepted and not yet due, and what is needed to judge the next.
#[derive(Debug, Clone)]
pub(crate) struct Inbox {
    images: VecDeque<Published>,
    pending: VecDeque<Pending>,
    last_receipt: Option<CommandReceipt>,
    newest_answered: Option<u64>,
}

/// What bounds a command.
pub(crate) struct Bounds<'a> {
    pub limits: &'a Limits,
    /// Measured pose of the probe at the start.
    pub base_from_probe_at_start: &'a Pose,
    pub command_delay_ticks: u64,
}

impl Inbox {
    pub(crate) fn new() -> Self {
        Self { images: VecDeque::new(), pending: VecDeque::new(), last_receipt: None, newest_answered: None }
    }

    pub(crate) fn last_receipt(&self) -> Option<CommandReceipt> {
        self.last_receipt
    }

    pub(crate) fn note_published(&mut self, image: &Acquisition) {
        if self.images.len() == REMEMBERED_IMAGES {
            self.images.pop_front();
        }
        self.images.push_back(Published {
            sequence: image.sequence,
            acquisition_tick: image.acquisition_tick,
            publication_tick: image.publication_tick,
        });
    }

    /// Refuses or schedules a command that arrives at `tick`.
    pub(crate) fn submit(&mut self, command: &Command, tick: u64, bounds: &Bounds) -> CommandReceipt {
        match self.judge(command, tick, bounds) {
            Ok((due_tick, image_tick)) => {
                self.newest_answered = Some(command.answers);
                self.pending.push_back(Pending { due_tick, image_tick, command: *command });
                let receipt = CommandReceipt { answers: command.answers, refused: None };
                self.last_receipt = Some(receipt);
                receipt
            }
            Err(refusal) => self.refuse(command.answers, refusal),
        }
    }

    pub(crate) fn refuse(&mut self, answers: u64, refusal: Refusal) -> CommandReceipt {
        let receipt = CommandReceipt { answers, refused: Some(refusal) };
        self.last_receipt = Some(receipt);
        receipt
    }

    /// The next command whose time has come.
    pub(crate) fn pop_due(&mut self, tick: u64) -> Option<Pending> {
        let index = self.pending.iter().position(|pending| pending.due_tick <= tick)?;
        self.pending.remove(index)
    }

    /// Tick at which the command takes effect, and that of the image that it answers.
    fn judge(&self, command: &Command, tick: u64, bounds: &Bounds) -> Result<(u64, u64), Refusal> {
        if !is_finite(command) {
            return Err(Refusal::NotFinite);
        }
        let Some(image) = self.images.iter().rev().find(|image| image.sequence == command.answers) else {
            let forgotten = self.images.front().is_some_and(|oldest| command.answers < oldest.sequence);
            return Err(if forgotten { Refusal::Stale } else { Refusal::UnknownImage });
        };
        let due = (image.publication_tick + bounds.command_delay_ticks).max(tick + 1);
        let image_delay_ticks = image.publication_tick.saturating_sub(image.acquisition_tick);
        let age_ticks = due.saturating_sub(image.acquisition_tick);
        if age_ticks > image_delay_ticks + bounds.command_delay_ticks + GRACE_TICKS {
            return Err(Refusal::Stale);
        }
        // The newest answer counts: one to an older image must not undo it.
        if self.newest_answered.is_some_and(|newest| command.answers < newest) {
            return Err(Refusal::Stale);
        }
        if !within(command, bounds) {
            return Err(Refusal::OutOfLimits);
        }
        Ok((due, image.acquisition_tick))
    }
}

fn is_finite(command: &Command) -> bool {
    let pose = command.target_base_from_probe.as_ref();
    let estimate = &command.estimate;
    let optional = [
        estimate.ncc_previous,
        estimate.ncc_anchor,
        estimate.brightness_ratio,
        estimate.tip_level,
        estimate.conditioning,
    ];
    command.feed_m_s.is_finite()
        && pose.is_none_or(|p| {
            p.translation.vector.iter().chain(p.rotation.coords.iter()).all(|value| value.is_finite())
        })
        && estimate.tip_px.iter().flatten().all(|value| value.is_finite())
        && optional.iter().flatten().all(|value| value.is_finite())
}

fn within(command: &Command, bounds: &Bounds) -> bool {
    let limits = bounds.limits;
    // A hair of tolerance: a servo that asks for exactly the limit may have rounded upwards.
    let at_most = |value: f64, limit: f64| value <= limit * (1.0 + 1e-9);
    let pose_is_within = command.target_base_from_probe.as_ref().is_none_or(|target| {
        let start = bounds.base_from_probe_at_start;
        let travel_m = (target.translation.vector - start.translation.vector).norm();
        let turn_rad = start.rotation.angle_to(&target.rotation);
        (target.rotation.coords.norm() - 1.0).abs() <= UNIT_TOLERANCE
            && at_most(travel_m, limits.max_probe_travel_m)
            && at_most(turn_rad, limits.max_probe_turn_rad)
    });
    command.feed_m_s >= 0.0 && at_most(command.feed_m_s, limits.max_feed_m_s) && pose_is_within
}

//! One run: the world is stepped, pictures are rendered and handed out, answers take effect.
//!
//! Simulated time waits for answers (lockstep), so nothing here depends on how fast anybody is. With a clock
//! ([`Session::paced_by`]) it follows the clock instead, and answers count from when they arrive.

use std::collections::VecDeque;
use std::time::Instant;

use sonoloop_scenario::{DisturbanceKind, Scenario, add_disturbance};
use sonoloop_types::{
    Acquisition, Command, CommandReceipt, EndReason, Event, EventKind, Image, Refusal, TrackState, Truth,
};
use sonoloop_ultrasound::Renderer;
use sonoloop_wire::Answer as WireAnswer;
use sonoloop_wire::layout::CommandMessage;
use sonoloop_world::{World, WorldError};

use crate::clock::Clock;
use crate::garbage::garbage;
use crate::output::snake;
use crate::peer::{Answer, Peer, PeerError};
use crate::posture::Posture;
use crate::record::{ImageRow, ImageStore, Recording, TickRow, Timing, image_hash};
use crate::steering::Request;

/// The needle has come to rest when it has not moved for this long.
const REST_TICKS: u64 = 400;

/// Somebody who watches a run, and may hold or disturb it.
pub trait Watch {
    /// After each picture (with its answer, when there is one).
    fn image(&mut self, row: &ImageRow, shown: &Shown);
    /// Before each picture is taken; returns when it may be. What was asked for meanwhile is added to the requests.
    fn before_image(&mut self, _truth: &Truth, _requests: &mut Vec<Request>) -> Result<(), PeerError> {
        Ok(())
    }
    /// True when the user asked for the end.
    fn interrupted(&mut self) -> bool {
        false
    }
}

/// A picture that was handed out, and what stood where when it was taken.
pub struct Shown<'a> {
    /// The picture.
    pub image: &'a Image,
    /// Robots, needle and phantom.
    pub posture: &'a Posture,
    /// All that has happened in the run so far.
    pub events: &'a [Event],
}

/// Watches nothing.
pub struct Nobody;

impl Watch for Nobody {
    fn image(&mut self, _row: &ImageRow, _shown: &Shown) {}
}

/// A picture on its way to the tracker.
struct InFlight {
    publication_tick: u64,
    image: Image,
    truth: Truth,
    acquisition: Acquisition,
    posture: Posture,
}

/// Whether the tracker answers.
#[derive(Clone, Copy)]
enum Tracker {
    Up {
        run_id: u64,
    },
    /// It is shown pictures.
    Hung,
    Down,
}

/// A scenario made ready: every check that needs the world has passed.
pub struct Session {
    scenario: Scenario,
    world: World,
    /// None where nobody looks: pictures stay black.
    renderer: Option<Renderer>,
    spare: Vec<Image>,
    /// The picture handed out last.
    shown: Option<Image>,
    clock: Option<Box<dyn Clock>>,
    /// Answers on their way, with the tick at which they were there; of a paced run.
    arrived: VecDeque<(u64, Result<Command, CommandReceipt>)>,
    /// Image handed out last.
    newest: u64,
    state: TrackState,
}

impl Session {
    /// Builds world and renderer; fails where a target cannot be reached.
    pub fn new(scenario: &Scenario) -> Result<Self, WorldError> {
        let world = World::new(scenario)?;
        let renderer =
            Renderer::new(scenario.probe.clone(), scenario.needle.clone(), world.tissue(), scenario.seed);
        Ok(Self {
            scenario: scenario.clone(),
            world,
            renderer: Some(renderer),
            spare: Vec::new(),
            shown: None,
            clock: None,
            arrived: VecDeque::new(),
            newest: 0,
            state: TrackState::Searching,
        })
    }

    /// Lets simulated time follow a clock: it waits for nobody's answer, and the newest command counts.
    pub fn paced_by(self, clock: Box<dyn Clock>) -> Self {
        Self { clock: Some(clock), ..self }
    }

    /// Draws nothing, for trackers that do not look: drawing is most of a run's time.
    pub fn undrawn(self) -> Self {
        Self { renderer: None, ..self }
    }

    /// Runs to the end. The recording is whole up to the end whatever the reason; the error, when there is one,
    /// says why it ended early. Pictures go into `pixels`, when given.
    pub fn run(
        mut self,
        run_id: u64,
        peer: &mut dyn Peer,
        watch: &mut dyn Watch,
        pixels: Option<ImageStore>,
    ) -> (Recording, Option<PeerError>) {
        let mut recording = Recording {
            ticks: Vec::new(),
            images: Vec::new(),
            events: Vec::new(),
            end: EndReason::TimeOver,
            timing: Timing::default(),
            pixels,
            disturbed: None,
        };
        let error = self.run_into(&mut recording, run_id, peer, watch).err();
        if let Some(error) = &error {
            recording.end = error.end_reason();
        }
        recording.events.extend(self.world.drain_events());
        let detail = snake(&recording.end);
        recording.events.push(Event { tick: self.world.tick(), kind: EventKind::End, detail });
        peer.end(recording.end);
        (recording, error)
    }

    fn run_into(
        &mut self,
        recording: &mut Recording,
        run_id: u64,
        peer: &mut dyn Peer,
        watch: &mut dyn Watch,
    ) -> Result<(), PeerError> {
        peer.start(&self.world.setup(run_id))?;
        let mut in_flight: VecDeque<InFlight> = VecDeque::new();
        let (mut down, mut hung) = (false, false);
        let mut rest_ticks = 0;
        let mut was_fed = false;
        let mut sequence = 0;
        let mut physics_ms = 0.0;
        // When the first picture was handed out, and for how long observers held the run since: that time is not its own.
        let (mut began, mut held_s) = (None, 0.0);

        for _ in 0..self.scenario.duration_ticks {
            let tick = self.world.tick();
            self.keep_time(tick, run_id, peer, recording)?;
            if self.world.tracker_down() != down {
                down = !down;
                if down { peer.kill()? } else { peer.restart()? }
            }
            if (self.world.tracker_hung() && !down) != hung {
                hung = !hung;
                peer.hang(hung)?;
            }
            if tick.is_multiple_of(self.scenario.image_period_ticks) {
                if watch.interrupted() {
                    return Err(PeerError::Interrupted);
                }
                let before = Instant::now();
                let mut requests = Vec::new();
                let held = watch.before_image(&self.world.truth(), &mut requests);
                if began.is_some() {
                    held_s += before.elapsed().as_secs_f64();
                }
                for request in requests {
                    let detail = self.take_up(request, peer, recording);
                    recording.events.push(Event { tick, kind: EventKind::Control, detail });
                }
                held?;
                if sequence > 0 {
                    recording.timing.physics_ms.push(physics_ms);
                    physics_ms = 0.0;
                }
                let last = in_flight.back().map(|last| &last.image);
                let image = self.acquire(sequence, last, &mut recording.timing);
                if self.world.drops_image(sequence) {
                    self.spare.push(image.image);
                } else {
                    in_flight.push_back(image);
                }
                sequence += 1;
            }
            while in_flight.front().is_some_and(|i| i.publication_tick <= tick) {
                let Some(mut due) = in_flight.pop_front() else { break };
                due.publication_tick = tick;
                let (began, _) = *began.get_or_insert_with(|| (Instant::now(), tick));
                let who = if down {
                    Tracker::Down
                } else if hung {
                    Tracker::Hung
                } else {
                    Tracker::Up { run_id }
                };
                let row = self.hand_out(due, who, peer, watch, recording)?;
                recording.timing.wall_s = began.elapsed().as_secs_f64() - held_s;
                if let Some(command) = &row.command {
                    self.note_state(command, recording);
                }
                recording.images.push(row);
            }
            let truth = self.world.truth();
            recording.ticks.push(TickRow::from(&truth));
            recording.events.extend(self.world.drain_events());
            // A hand that pauses on its way has not come to rest: it has been asked to go on.
            let pausing = self.scenario.insertion.hand.is_some()
                && recording.images.last().and_then(|row| row.command).is_some_and(|c| c.feed_m_s > 0.0);
            let moving = truth.feed_m_s > 0.0 || pausing;
            was_fed |= truth.feed_m_s > 0.0;
            rest_ticks = if moving { 0 } else { rest_ticks + 1 };
            let arrived = was_fed
                && rest_ticks >= REST_TICKS
                && truth.target_distance_m <= self.scenario.insertion.target_tolerance_m;
            let over = self.scenario.images.map_or(arrived, |images| recording.images.len() as u64 >= images);
            if over {
                if arrived {
                    recording.end = EndReason::TargetReached;
                }
                break;
            }
            let before = Instant::now();
            self.world.step();
            physics_ms += before.elapsed().as_secs_f32() * 1e3;
        }
        let (began, first_tick) = began.unwrap_or((Instant::now(), self.world.tick()));
        if self.clock.is_some() {
            recording.timing.wall_s = began.elapsed().as_secs_f64() - held_s;
        }
        recording.timing.simulated_s =
            (self.world.tick() - first_tick) as f64 / sonoloop_types::TICKS_PER_SECOND as f64;
        Ok(())
    }

    /// Waits until `tick` is due, where there is a clock, and lets those answers count that are there by then.
    fn keep_time(
        &mut self,
        tick: u64,
        run_id: u64,
        peer: &mut dyn Peer,
        recording: &mut Recording,
    ) -> Result<(), PeerError> {
        let Some(clock) = &mut self.clock else { return Ok(()) };
        let now = clock.wait_until(tick);
        let behind = &mut recording.timing.behind_ticks;
        *behind = Some(behind.unwrap_or(0).max(now - tick));
        // A run that is behind must not let an answer act before it was there.
        self.arrived.extend(peer.poll()?.into_iter().map(|answer| (now, answer)));
        while self.arrived.front().is_some_and(|(there, _)| *there <= tick) {
            let Some((_, answer)) = self.arrived.pop_front() else { break };
            let answer = match answer {
                Ok(command) => {
                    recording.timing.track_us.push(command.compute_us);
                    self.take(command.answers, Ok(command), run_id)
                }
                Err(receipt) => {
                    self.take(receipt.answers, Err(receipt.refused.unwrap_or(Refusal::Malformed)), run_id)
                }
            };
            let Some(command) = answer else { continue };
            self.note_state(&command, recording);
            let mut rows = recording.images.iter_mut().rev();
            if let Some(row) = rows.find(|row| row.acquisition.sequence == command.answers) {
                row.command = Some(command);
            }
        }
        Ok(())
    }

    fn note_state(&mut self, command: &Command, recording: &mut Recording) {
        if command.estimate.state == self.state {
            return;
        }
        self.state = command.estimate.state;
        let (is, why) = (snake(&self.state), snake(&command.estimate.reason));
        let detail = format!("{is}: {why}, image {}", command.answers);
        recording.events.push(Event { tick: self.world.tick(), kind: EventKind::StateChange, detail });
    }

    /// Does what an observer asked for, as far as it concerns the world; says what was done.
    fn take_up(&mut self, request: Request, peer: &dyn Peer, recording: &mut Recording) -> String {
        let Some(entry) = request.disturbance else { return request.text };
        let scenario = recording.disturbed.as_ref().unwrap_or(&self.scenario);
        match add_disturbance(scenario, &entry, self.world.tick() + 1) {
            Ok((_, DisturbanceKind::TrackerKilled { .. })) if !peer.can_kill() => {
                format!("refused: the tracker was started elsewhere: {entry}")
            }
            Ok((scenario, kind)) => {
                recording.disturbed = Some(scenario);
                self.world.disturb(kind);
                request.text
            }
            Err(why) => format!("refused: {why}: {entry}"),
        }
    }

    /// Takes a picture. `last` is the one before, where it has not been handed out yet.
    fn acquire(&mut self, sequence: u64, last: Option<&Image>, timing: &mut Timing) -> InFlight {
        let tick = self.world.tick();
        let slice = self.world.slice(sequence);
        let geometry = self.scenario.probe.geometry;
        let mut image =
            self.spare.pop().unwrap_or_else(|| Image::black(geometry.width_px, geometry.height_px));
        let before = Instant::now();
        match last.or(self.shown.as_ref()).filter(|_| self.world.images_frozen()) {
            Some(last) => image.clone_from(last),
            None => {
                if let Some(renderer) = &mut self.renderer {
                    renderer.render(&slice, &mut image);
                }
            }
        }
        timing.render_ms.push(before.elapsed().as_secs_f32() * 1e3);
        InFlight {
            publication_tick: tick + self.world.image_delay_ticks(),
            image,
            truth: self.world.truth(),
            acquisition: self.world.acquisition(sequence),
            posture: Posture::of(&self.world, &slice),
        }
    }

    fn hand_out(
        &mut self,
        due: InFlight,
        tracker: Tracker,
        peer: &mut dyn Peer,
        watch: &mut dyn Watch,
        recording: &mut Recording,
    ) -> Result<ImageRow, PeerError> {
        let acquisition = Acquisition { publication_tick: due.publication_tick, ..due.acquisition };
        self.world.note_published(&acquisition);
        self.newest = acquisition.sequence;
        let command_age_ticks = self.world.command_age_ticks();
        let mut kept = None;
        let mut keep = || {
            let pushed = recording.pixels.as_mut().map_or(Ok(()), |pixels| pixels.push(&due.image));
            (image_hash(&due.image), pushed)
        };
        let mut command = None;
        match tracker {
            // A tracker in another process works meanwhile.
            Tracker::Up { run_id } if self.clock.is_none() => {
                let before = Instant::now();
                if let Some(answer) = peer.exchange(&acquisition, &due.image, &mut || kept = Some(keep()))? {
                    let round_trip_us = before.elapsed().as_secs_f32() * 1e6;
                    if let Ok(command) = &answer {
                        recording.timing.track_us.push(command.compute_us);
                        recording.timing.wire_us.push((round_trip_us - command.compute_us).max(0.0));
                    }
                    command = self.take(acquisition.sequence, answer, run_id);
                }
            }
            Tracker::Up { .. } => peer.post(&acquisition, &due.image)?,
            Tracker::Hung => peer.show(&acquisition, &due.image)?,
            Tracker::Down => {}
        }
        let (hash, pushed) = kept.unwrap_or_else(keep);
        pushed.map_err(|e| PeerError::Fault(format!("the pictures cannot be kept: {e}")))?;
        let row = ImageRow { acquisition, hash, truth: due.truth, command, command_age_ticks };
        for stray in peer.strays() {
            if let Some(refusal) = stray.refused {
                self.world.refuse(stray.answers, refusal);
            }
        }
        watch.image(&row, &Shown { image: &due.image, posture: &due.posture, events: &recording.events });
        self.spare.extend(self.shown.replace(due.image));
        Ok(row)
    }

    /// Passes the answer to image `sequence` on to the world, or what the scenario makes of it; returns what counts as the tracker's word.
    fn take(&mut self, sequence: u64, answer: Answer, run_id: u64) -> Option<Command> {
        match (answer, self.world.garbage(sequence)) {
            (Ok(command), None) => {
                self.world.submit(&command);
                Some(command)
            }
            (Err(refusal), None) => {
                self.world.refuse(sequence, refusal);
                None
            }
            (answer, Some(words)) => {
                let honest = answer.ok().map(|command| CommandMessage::encode(run_id, &command));
                let message = garbage(&honest.unwrap_or_default(), &words, &self.scenario.limits);
                match WireAnswer::read(&message, run_id, Some(self.newest)) {
                    WireAnswer::Command(command) => {
                        self.world.submit(&command).refused.is_none().then_some(command)
                    }
                    WireAnswer::Refused(receipt) => {
                        self.world.refuse(receipt.answers, receipt.refused.unwrap_or(Refusal::Malformed));
                        None
                    }
                }
            }
        }
    }
}

/// True when a disturbance of the scenario kills the tracker.
pub fn kills_tracker(scenario: &Scenario) -> bool {
    scenario.disturbances.iter().any(|d| matches!(d.kind, DisturbanceKind::TrackerKilled { .. }))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use sonoloop_types::Setup;

    use super::*;
    use crate::judge::test_recording::image_row;
    use crate::peer::TrackerName;
    use crate::scenarios::prepare;

    /// A clock that shows what it is asked for, but stands at `stalls.1` once it has come to `stalls.0`, as when the machine
    /// was busy in between.
    struct Scripted {
        stalls: (u64, u64),
    }

    impl Clock for Scripted {
        fn wait_until(&mut self, tick: u64) -> u64 {
            let (from, to) = self.stalls;
            if tick > from { tick.max(to) } else { tick }
        }
    }

    /// Answers every image once so many more have come; never, without a number.
    struct Late {
        images: Option<usize>,
        posted: VecDeque<u64>,
    }

    impl Peer for Late {
        fn name(&self) -> TrackerName {
            TrackerName::own()
        }
        fn start(&mut self, _setup: &Setup) -> Result<(), PeerError> {
            Ok(())
        }
        fn exchange(
            &mut self,
            _: &Acquisition,
            _: &Image,
            _: &mut dyn FnMut(),
        ) -> Result<Option<Answer>, PeerError> {
            panic!("a paced run waits for nobody")
        }
        fn post(&mut self, acquisition: &Acquisition, _image: &Image) -> Result<(), PeerError> {
            self.posted.push_back(acquisition.sequence);
            Ok(())
        }
        fn poll(&mut self) -> Result<Vec<Result<Command, CommandReceipt>>, PeerError> {
            let late = self.images.unwrap_or(usize::MAX);
            let due = self.posted.len().saturating_sub(late);
            let row = |sequence| image_row(sequence, true, Some(TrackState::Tracking), 0.0);
            Ok(self.posted.drain(..due).map(|sequence| Ok(row(sequence).command.unwrap())).collect())
        }
        fn kill(&mut self) -> Result<(), PeerError> {
            Ok(())
        }
        fn restart(&mut self) -> Result<(), PeerError> {
            Ok(())
        }
        fn end(&mut self, _reason: EndReason) {}
    }

    /// One second against such a peer and clock.
    fn paced(images: Option<usize>, stalls: (u64, u64)) -> Recording {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/lateral_plain.yaml");
        let (_, session) = prepare(&file, Some(0), &["duration_s=1".to_owned()]).unwrap();
        let mut peer = Late { images, posted: VecDeque::new() };
        let (recording, error) =
            session.paced_by(Box::new(Scripted { stalls })).run(1, &mut peer, &mut Nobody, None);
        assert!(error.is_none(), "{error:?}");
        assert_eq!((recording.ticks.len(), recording.images.len()), (1000, 25));
        recording
    }

    fn ages(recording: &Recording) -> Vec<u64> {
        recording.images.iter().map(|row| row.command_age_ticks).collect()
    }

    #[test]
    fn a_tracker_that_never_answers_cannot_stop_the_clock_and_its_silence_is_told() {
        let recording = paced(None, (1000, 1000));
        assert_eq!(ages(&recording), (0..25).map(|k| 40 * k).collect::<Vec<u64>>());
        assert!(recording.images.iter().all(|row| row.command.is_none()));
        assert_eq!(recording.timing.behind_ticks, Some(0));
        assert!(recording.ticks.iter().all(|row| row.feed_m_s == 0.0));
        let timing = crate::output::TimingSummary::of(&recording);
        assert_eq!((timing.images_without_answer, timing.staleness_ms_max), (25, Some(960.0)));
        assert_eq!(timing.staleness_ms_p50, Some(480.0));
    }

    #[test]
    fn an_answer_counts_from_when_it_arrives_and_is_as_old_as_its_image() {
        let recording = paced(Some(3), (1000, 1000));
        // The answer to image k comes with image k + 3 and is in force when image k + 4 is handed out.
        let expected: Vec<u64> = (0..25).map(|k: u64| if k < 4 { 40 * k } else { 160 }).collect();
        assert_eq!(ages(&recording), expected);
        assert_eq!(recording.images.iter().filter(|row| row.command.is_none()).count(), 3);
        assert_eq!(recording.events.iter().filter(|event| event.kind == EventKind::StateChange).count(), 1);
    }

    #[test]
    fn a_run_behind_the_clock_lets_no_answer_act_before_it_was_there() {
        // From tick 400 on the machine was busy until 550: what is found then was not there before.
        let recording = paced(Some(0), (400, 550));
        let expected: Vec<u64> = (0..25)
            .map(|k: u64| match 40 * k {
                0 => 0,
                tick @ 400..=550 => tick - 360,
                _ => 40,
            })
            .collect();
        assert_eq!(ages(&recording), expected);
        assert_eq!(recording.timing.behind_ticks, Some(149));
    }
}

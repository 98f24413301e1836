//! The numbers that stand for enumerations; published in `docs/wire.md`, never to be reused.

use sonoloop_types::{ArmStatus, EndReason, Reason, Refusal, TrackState};

use super::Defect;

/// An enumeration whose members have a number on the wire.
pub(super) trait Coded: Copy + PartialEq + 'static {
    /// Every member with its number.
    const CODES: &'static [(Self, u8)];
}

pub(super) fn encode<T: Coded>(member: T) -> u8 {
    T::CODES
        .iter()
        .find(|(candidate, _)| *candidate == member)
        .map(|&(_, code)| code)
        // A member without a number is refused by every reader; a test shows that there is none.
        .unwrap_or(u8::MAX)
}

pub(super) fn decode<T: Coded>(value: u8, field: &'static str) -> Result<T, Defect> {
    T::CODES
        .iter()
        .find(|(_, code)| *code == value)
        .map(|&(member, _)| member)
        .ok_or(Defect::Code { field, value })
}

impl Coded for TrackState {
    const CODES: &'static [(Self, u8)] =
        &[(Self::Searching, 0), (Self::Tracking, 1), (Self::Lost, 2), (Self::Recovering, 3)];
}

impl Coded for Reason {
    const CODES: &'static [(Self, u8)] = &[
        (Self::Ok, 0),
        (Self::NccPrevious, 1),
        (Self::NccAnchor, 2),
        (Self::Brightness, 3),
        (Self::OutOfImage, 4),
        (Self::Diverged, 5),
        (Self::Singular, 6),
        (Self::NoCandidate, 7),
        (Self::Candidate, 8),
        (Self::Restarted, 9),
        (Self::Frozen, 10),
    ];
}

impl Coded for ArmStatus {
    const CODES: &'static [(Self, u8)] =
        &[(Self::Ready, 0), (Self::Holding, 1), (Self::Collision, 2), (Self::Unreachable, 3)];
}

/// In the image header 0 means "no command yet" and 1 "accepted", so refusals begin at 2.
impl Coded for Refusal {
    const CODES: &'static [(Self, u8)] = &[
        (Self::NotFinite, 2),
        (Self::OutOfLimits, 3),
        (Self::OtherRun, 4),
        (Self::Stale, 5),
        (Self::UnknownImage, 6),
        (Self::Malformed, 7),
    ];
}

impl Coded for EndReason {
    const CODES: &'static [(Self, u8)] = &[
        (Self::TargetReached, 0),
        (Self::TimeOver, 1),
        (Self::TrackerSilent, 2),
        (Self::TrackerDied, 3),
        (Self::Interrupted, 4),
        (Self::Fault, 5),
    ];
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The matches below stop compiling when an enumeration grows, so that its table grows with it.
    #[test]
    fn every_member_has_a_number_of_its_own() {
        fn check<T: Coded + std::fmt::Debug>(members: usize) {
            assert_eq!(T::CODES.len(), members);
            for &(member, code) in T::CODES {
                assert_eq!(encode(member), code);
                assert_eq!(decode::<T>(code, "x"), Ok(member));
            }
            assert_eq!(decode::<T>(200, "x"), Err(Defect::Code { field: "x", value: 200 }));
        }
        match TrackState::Lost {
            TrackState::Searching | TrackState::Tracking | TrackState::Lost | TrackState::Recovering => {
                check::<TrackState>(4);
            }
        }
        match Reason::Ok {
            Reason::Ok
            | Reason::NccPrevious
            | Reason::NccAnchor
            | Reason::Brightness
            | Reason::OutOfImage
            | Reason::Diverged
            | Reason::Singular
            | Reason::NoCandidate
            | Reason::Candidate
            | Reason::Restarted
            | Reason::Frozen => check::<Reason>(11),
        }
        match ArmStatus::Ready {
            ArmStatus::Ready | ArmStatus::Holding | ArmStatus::Collision | ArmStatus::Unreachable => {
                check::<ArmStatus>(4);
            }
        }
        match Refusal::Stale {
            Refusal::NotFinite
            | Refusal::OutOfLimits
            | Refusal::OtherRun
            | Refusal::Stale
            | Refusal::UnknownImage
            | Refusal::Malformed => check::<Refusal>(6),
        }
        match EndReason::Fault {
            EndReason::TargetReached
            | EndReason::TimeOver
            | EndReason::TrackerSilent
            | EndReason::TrackerDied
            | EndReason::Interrupted
            | EndReason::Fault => check::<EndReason>(6),
        }
    }
}

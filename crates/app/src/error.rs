//! What can go wrong in a command, and the exit code that says so.

use std::process::ExitCode;

use sonoloop_scenario::LoadError;

/// Outcome of a command that did its work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// All expectations held.
    Pass,
    /// At least one did not.
    Fail,
}

impl From<Outcome> for ExitCode {
    fn from(outcome: Outcome) -> Self {
        match outcome {
            Outcome::Pass => Self::SUCCESS,
            Outcome::Fail => Self::from(1),
        }
    }
}

/// A command that could not do its work.
#[derive(Debug, thiserror::Error)]
pub enum AppError {
    /// What the user gave cannot be used; nothing was written.
    #[error("{0}")]
    BadInput(String),
    /// Something failed on the way.
    #[error("error: {0}")]
    Fault(String),
}

/// A file that a person wrote is bad input; its error shows the line.
impl From<LoadError> for AppError {
    fn from(error: LoadError) -> Self {
        Self::BadInput(error.render())
    }
}

impl AppError {
    /// 2 for bad input, 3 for a fault.
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Self::BadInput(_) => ExitCode::from(2),
            Self::Fault(_) => ExitCode::from(3),
        }
    }

    /// A fault from anything that can be shown.
    pub fn fault(error: impl std::fmt::Display) -> Self {
        Self::Fault(error.to_string())
    }

    /// Bad input from anything that can be shown.
    pub fn bad_input(error: impl std::fmt::Display) -> Self {
        Self::BadInput(error.to_string())
    }
}

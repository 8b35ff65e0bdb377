//! Any number of viewers, one of them steering.
//!
//! The first that asks for something that changes anything gets the wheel and keeps it until it leaves or hands it over; another may take
//! it deliberately. A request without a connection steers only while nobody holds the wheel.

use std::sync::{Mutex, PoisonError};

/// Number of a viewer.
pub type Viewer = u64;

/// See the module.
#[derive(Debug, Default)]
pub struct Steering(Mutex<State>);

#[derive(Debug, Default)]
struct State {
    next: Viewer,
    viewers: u64,
    holder: Option<Viewer>,
}

impl Steering {
    /// A viewer has come.
    pub fn join(&self) -> Viewer {
        self.with(|state| {
            state.next += 1;
            state.viewers += 1;
            state.next
        })
    }

    /// It has left.
    pub fn leave(&self, viewer: Viewer) {
        self.with(|state| {
            state.viewers -= 1;
            state.holder.take_if(|holder| *holder == viewer);
        });
    }

    /// Who steers, and how many look on in all.
    pub fn state(&self) -> (Option<Viewer>, u64) {
        self.with(|state| (state.holder, state.viewers))
    }

    /// Whether this viewer may steer now; takes the wheel if nobody has it, or from whoever has it if asked to.
    pub fn take(&self, viewer: Viewer, from_others: bool) -> bool {
        self.with(|state| {
            if state.holder.is_none() || from_others {
                state.holder = Some(viewer);
            }
            state.holder == Some(viewer)
        })
    }

    /// Lets go of the wheel.
    pub fn release(&self, viewer: Viewer) {
        self.with(|state| {
            state.holder.take_if(|holder| *holder == viewer);
        });
    }

    fn with<T>(&self, change: impl FnOnce(&mut State) -> T) -> T {
        change(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_steers_until_it_leaves_or_is_relieved() {
        let steering = Steering::default();
        let (a, b) = (steering.join(), steering.join());
        assert!(steering.take(a, false) && !steering.take(b, false));
        assert_eq!(steering.state(), (Some(a), 2));
        assert!(steering.take(b, true) && !steering.take(a, false));
        steering.release(a);
        assert_eq!(steering.state().0, Some(b));
        steering.leave(b);
        assert_eq!(steering.state(), (None, 1));
        assert!(steering.take(a, false));
    }
}

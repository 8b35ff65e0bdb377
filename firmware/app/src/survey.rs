//! The survey's task: works off its queue at the lowest priority and hands profiles back to the acquisition's side.

use crossfall_core::instrument::{Event, Survey};
use crossfall_protocol::message::Profile;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::{Channel, Receiver, Sender};

use crate::work::WorkReceiver;

/// Profiles that may wait. An input can bring about one for each waiting scan, but they are measured one at a time, and the link's side, at a
/// higher priority, takes each before the next is ready.
const WAITING: usize = 2;

/// Profiles on their way to the link.
pub type Profiles = Channel<CriticalSectionRawMutex, Profile, WAITING>;

/// The survey's end of [`Profiles`].
pub type ProfileSender<'q> = Sender<'q, CriticalSectionRawMutex, Profile, WAITING>;

/// The link's end of [`Profiles`].
pub type ProfileReceiver<'q> = Receiver<'q, CriticalSectionRawMutex, Profile, WAITING>;

/// Works for ever.
pub async fn survey(survey: &mut Survey, mut work: WorkReceiver<'_>, profiles: ProfileSender<'_>) -> ! {
    loop {
        let accept = |event: &Event<'_>| survey.accept(event);
        if let Some(profile) = work.next(accept).await {
            profiles.send(profile).await;
        }
        while let Some(profile) = survey.next_profile() {
            profiles.send(profile).await;
        }
    }
}

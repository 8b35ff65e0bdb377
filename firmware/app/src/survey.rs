//! The survey's task: works off its queue at the lowest priority and hands profiles back to the acquisition's side.

use crossfall_core::instrument::{Survey, WAITING};
use crossfall_protocol::message::Profile;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::{Channel, Receiver, Sender};
use embassy_time::Timer;

use crate::work::WorkReceiver;

/// Profiles that one input can bring about: all the waiting scans', and one that its arrival pushes out.
const AT_ONCE: usize = WAITING + 1;

/// Profiles on their way to the link.
pub type Profiles = Channel<CriticalSectionRawMutex, Profile, AT_ONCE>;

/// The survey's end of [`Profiles`].
pub type ProfileSender<'q> = Sender<'q, CriticalSectionRawMutex, Profile, AT_ONCE>;

/// The link's end of [`Profiles`].
pub type ProfileReceiver<'q> = Receiver<'q, CriticalSectionRawMutex, Profile, AT_ONCE>;

/// Works for ever.
pub async fn survey(survey: &mut Survey, mut work: WorkReceiver<'_>, profiles: ProfileSender<'_>) -> ! {
    loop {
        // Room for all that one input can bring about, so that none of it is lost. The link's side runs at a higher
        // priority and has emptied the queue long before, unless it stands still.
        while !profiles.is_empty() {
            Timer::after_millis(1).await;
        }
        work.next(|event| {
            survey.take(event, &mut |profile| {
                let _fits = profiles.try_send(profile);
            });
        })
        .await;
    }
}

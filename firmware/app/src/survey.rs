//! The survey's task: works off its queue at the lowest priority and hands profiles back to the acquisition's side.

use crossfall_core::instrument::{Event, Survey, WAITING};
use crossfall_protocol::Message;
use crossfall_protocol::message::Profile;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::{Channel, Sender};
use embassy_sync::zerocopy_channel::Receiver;

use crate::acquisition::Work;

/// Profiles on their way to the link. When it is full the survey waits: nothing is lost here.
pub type Profiles = Channel<CriticalSectionRawMutex, Profile, 2>;

/// The survey's end of [`Profiles`].
pub type ProfileSender<'q> = Sender<'q, CriticalSectionRawMutex, Profile, 2>;

/// Profiles that one input can bring about: all the waiting scans', and one that its arrival pushes out.
const AT_ONCE: usize = WAITING + 1;

/// Works for ever.
pub async fn survey(
    survey: &mut Survey,
    mut work: Receiver<'_, CriticalSectionRawMutex, Work>,
    profiles: ProfileSender<'_>,
) -> ! {
    let mut done: heapless::Vec<Profile, AT_ONCE> = heapless::Vec::new();
    loop {
        {
            let mut keep = |profile| {
                // Has room by the bound above.
                let _fits = done.push(profile);
            };
            match work.receive().await {
                Work::None => {}
                Work::Scan(scan) => survey.take(&Event::Scan(scan), &mut keep),
                Work::Pose(pose) => survey.take(&Event::Message(Message::Pose(*pose)), &mut keep),
                Work::Config(config) => survey.take(&Event::Message(Message::Config(*config)), &mut keep),
                Work::Session(session) => survey.take(&Event::Message(Message::Session(*session)), &mut keep),
            }
        }
        work.receive_done();
        for &profile in &done {
            profiles.send(profile).await;
        }
        done.clear();
    }
}

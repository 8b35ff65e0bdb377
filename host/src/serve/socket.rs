//! One viewer's WebSocket: sections, charts, track and state out; requests in, one answer each.
//!
//! What is sent is fetched when it can be sent: a viewer that is slow is behind by what the system buffers for it and no more, one that
//! takes nothing for [`STUCK`] is given up.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::response::Response;
use serde_json::{Value, json};
use tokio::time::{MissedTickBehavior, interval, timeout};

use super::Served;
use super::steering::Viewer;
use crate::live::{Cursor, Request};

/// How often a viewer is looked after: faster than the scanner's 37.5 a second.
const TICK: Duration = Duration::from_millis(20);

/// A viewer that takes nothing for so long is given up.
const STUCK: Duration = Duration::from_secs(10);

/// Longest message from a viewer.
const LONGEST: usize = 32 << 10;

/// Viewers that are looked after at a time.
const MOST_VIEWERS: u64 = 32;

/// Takes a viewer on.
pub async fn open(State(served): State<Arc<Served>>, upgrade: WebSocketUpgrade) -> Response {
    upgrade.max_message_size(LONGEST).max_frame_size(LONGEST).on_upgrade(move |socket| async move {
        let viewer = served.steering.join();
        if served.steering.state().1 <= MOST_VIEWERS {
            look_after(&served, socket, viewer).await;
        }
        served.steering.leave(viewer);
    })
}

async fn look_after(served: &Served, mut socket: WebSocket, viewer: Viewer) {
    let mut cursor = Cursor::default();
    let mut told = None;
    let mut ticks = interval(TICK);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        let sent = tokio::select! {
            _ = ticks.tick() => update(served, &mut socket, viewer, &mut cursor, &mut told).await,
            message = socket.recv() => match message {
                Some(Ok(Message::Text(text))) => {
                    let answer = answer(served, viewer, text.as_str()).await;
                    send(&mut socket, Message::Text(answer.to_string().into())).await
                }
                Some(Ok(Message::Binary(_))) => {
                    let words = "requests are JSON in text messages";
                    send(&mut socket, Message::Text(refuse(&Value::Null, words).to_string().into())).await
                }
                Some(Ok(Message::Ping(_) | Message::Pong(_))) => Some(()),
                Some(Ok(Message::Close(_)) | Err(_)) | None => None,
            },
        };
        if sent.is_none() {
            return;
        }
    }
}

/// Sends what is new; nothing comes back when the viewer is gone.
async fn update(
    served: &Served,
    socket: &mut WebSocket,
    viewer: Viewer,
    cursor: &mut Cursor,
    told: &mut Option<(Option<Viewer>, u64)>,
) -> Option<()> {
    let news = served.live.hub().news(cursor);
    if let Some(section) = news.section {
        send(socket, Message::Binary(section.to_vec().into())).await?;
        served.metrics.section_sent();
    }
    for bytes in [news.strips, news.track].into_iter().flatten() {
        send(socket, Message::Binary(bytes.into())).await?;
    }
    if let Some(state) = news.state {
        send(socket, Message::Text((*state).into())).await?;
    }
    let steering = served.steering.state();
    if *told != Some(steering) {
        *told = Some(steering);
        let (holder, viewers) = steering;
        let words = json!({
            "kind": "control",
            "mine": holder == Some(viewer),
            "held": holder.is_some(),
            "viewers": viewers,
        });
        send(socket, Message::Text(words.to_string().into())).await?;
    }
    Some(())
}

async fn send(socket: &mut WebSocket, message: Message) -> Option<()> {
    timeout(STUCK, socket.send(message)).await.ok()?.ok()
}

/// What comes of a request.
async fn answer(served: &Served, viewer: Viewer, text: &str) -> Value {
    let mut value: Value = match serde_json::from_str(text) {
        Ok(value) => value,
        Err(error) => return refuse(&Value::Null, &format!("not JSON: {error}")),
    };
    let Some(fields) = value.as_object_mut() else { return refuse(&Value::Null, "expected an object") };
    let id = fields.remove("id").unwrap_or_default();
    match fields.get("do").and_then(Value::as_str) {
        Some("control") => {
            let from_others = fields.get("take").and_then(Value::as_bool).unwrap_or(false);
            return if served.steering.take(viewer, from_others) {
                json!({ "kind": "reply", "id": id, "ok": true })
            } else {
                refuse(&id, "another viewer steers")
            };
        }
        Some("release") => {
            served.steering.release(viewer);
            return json!({ "kind": "reply", "id": id, "ok": true });
        }
        _ => {}
    }
    let request = match Request::from_json(value) {
        Ok(request) => request,
        Err(error) => return refuse(&id, &error.to_string()),
    };
    if !served.steering.take(viewer, false) {
        return refuse(&id, "another viewer steers");
    }
    served.metrics.commanded();
    match served.live.execute(request).await {
        Ok(result) => json!({ "kind": "reply", "id": id, "ok": true, "result": result }),
        Err(refusal) => refuse(&id, &refusal.to_string()),
    }
}

fn refuse(id: &Value, words: &str) -> Value {
    json!({ "kind": "reply", "id": id, "ok": false, "error": words })
}

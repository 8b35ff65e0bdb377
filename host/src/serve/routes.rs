//! The paths of the interface.

use std::sync::Arc;

use axum::Router;
use axum::body::Bytes;
use axum::extract::{DefaultBodyLimit, Request, State};
use axum::http::{HeaderValue, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::{any, get, post};
use serde_json::{Value, json};
use tokio::time::timeout;

use super::access::{COOKIE, Verdict};
use super::{Access, REQUEST, Served, assets, metrics, socket};
use crate::live::{Refusal, Request as Wanted};

/// Longest body of a request: a configuration with comments is 3 kB.
const LONGEST_BODY: usize = 32 << 10;

/// Nothing from elsewhere, nothing inline.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Every path, behind the gate.
pub fn router(served: Arc<Served>) -> Router {
    let mut router = Router::new()
        .route("/api/state", get(state))
        .route("/api/config", get(config))
        .route("/api/command", post(command))
        .route("/api/live", any(socket::open))
        .route("/metrics", get(metrics::page));
    for asset in assets::ASSETS {
        let page = || async { ([(header::CONTENT_TYPE, asset.content_type)], asset.body) };
        router = router.route(asset.path, get(page));
    }
    router
        .fallback(|| async { told(StatusCode::NOT_FOUND, "there is nothing here") })
        .method_not_allowed_fallback(|| async { told(StatusCode::METHOD_NOT_ALLOWED, "not like this") })
        .layer(DefaultBodyLimit::max(LONGEST_BODY))
        .layer(middleware::from_fn_with_state(Arc::clone(&served), gate))
        .with_state(served)
}

/// Turns away who may not look, before anything else looks at the request.
async fn gate(State(served): State<Arc<Served>>, request: Request, next: Next) -> Response {
    let mut response = match served.access.judge(request.uri(), request.headers()) {
        Verdict::Granted => in_time(request, next).await,
        Verdict::GrantedByQuery => {
            let is_page = request.uri().path() == "/";
            with_cookie(&served.access, is_page, in_time(request, next).await)
        }
        Verdict::NoToken => {
            served.metrics.refused();
            told(
                StatusCode::UNAUTHORIZED,
                "the token is missing or wrong: use the address that `crossfall serve` printed",
            )
        }
        Verdict::Foreign => {
            served.metrics.refused();
            told(StatusCode::FORBIDDEN, "this request names another host or comes from another site's page")
        }
    };
    let headers = response.headers_mut();
    for (name, value) in [
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::CACHE_CONTROL, "no-store"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    response
}

/// The answer, unless the request's body takes too long to come.
async fn in_time(request: Request, next: Next) -> Response {
    let late = |_| told(StatusCode::REQUEST_TIMEOUT, "the request did not come to its end");
    timeout(REQUEST, next.run(request)).await.unwrap_or_else(late)
}

/// An answer to a request that had nothing to ask.
fn told(status: StatusCode, words: &str) -> Response {
    (status, [(header::CONTENT_TYPE, "application/json")], json!({ "error": words }).to_string()).into_response()
}

fn as_json(value: &Value) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], value.to_string()).into_response()
}

async fn state(State(served): State<Arc<Served>>) -> Response {
    let body = served.live.hub().json().to_string();
    ([(header::CONTENT_TYPE, "application/json")], body).into_response()
}

async fn config(State(served): State<Arc<Served>>) -> Response {
    match served.live.hub().config() {
        Some(config) => as_json(&json!({ "toml": crate::config::to_toml(&config) })),
        None => told(StatusCode::SERVICE_UNAVAILABLE, "the board has not said its configuration yet"),
    }
}

async fn command(State(served): State<Arc<Served>>, body: Bytes) -> Response {
    let wanted = match serde_json::from_slice(&body).and_then(Wanted::from_json) {
        Ok(wanted) => wanted,
        Err(error) => return told(StatusCode::BAD_REQUEST, &error.to_string()),
    };
    if served.steering.state().0.is_some() {
        return told(StatusCode::CONFLICT, "a viewer steers: ask there, or let it release the control");
    }
    served.metrics.commanded();
    match served.live.execute(wanted).await {
        Ok(value) => as_json(&value),
        Err(refusal) => told(status_of(&refusal), &refusal.to_string()),
    }
}

fn status_of(refusal: &Refusal) -> StatusCode {
    match refusal {
        Refusal::Invalid(_) => StatusCode::BAD_REQUEST,
        Refusal::Conflict(_) => StatusCode::CONFLICT,
        Refusal::Board(_) => StatusCode::BAD_GATEWAY,
    }
}

/// Keeps the token out of the address from here on: sets the cookie, and sends the page's reader to the plain address.
fn with_cookie(access: &Access, is_page: bool, response: Response) -> Response {
    let Access::Token(token) = access else { return response };
    let cookie = format!("{COOKIE}={token}; Path=/; HttpOnly; SameSite=Strict");
    let Ok(cookie) = HeaderValue::from_str(&cookie) else { return response };
    if is_page {
        let place = [(header::LOCATION, HeaderValue::from_static("/")), (header::SET_COOKIE, cookie)];
        return (StatusCode::SEE_OTHER, place).into_response();
    }
    response
}

//! The page, as written under `host/assets` and embedded in the program: no build step, no network.

/// One file of the page.
pub struct Asset {
    /// Its path in a request.
    pub path: &'static str,
    /// Its type.
    pub content_type: &'static str,
    /// It.
    pub body: &'static str,
}

const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const SVG: &str = "image/svg+xml";

/// Every file of the page.
pub const ASSETS: &[Asset] = &[
    Asset { path: "/", content_type: HTML, body: include_str!("../../assets/index.html") },
    Asset { path: "/live.css", content_type: CSS, body: include_str!("../../assets/live.css") },
    Asset { path: "/icon.svg", content_type: SVG, body: include_str!("../../assets/icon.svg") },
    Asset { path: "/main.js", content_type: SCRIPT, body: include_str!("../../assets/main.js") },
    Asset { path: "/wire.js", content_type: SCRIPT, body: include_str!("../../assets/wire.js") },
    Asset { path: "/section.js", content_type: SCRIPT, body: include_str!("../../assets/section.js") },
    Asset { path: "/charts.js", content_type: SCRIPT, body: include_str!("../../assets/charts.js") },
    Asset { path: "/panels.js", content_type: SCRIPT, body: include_str!("../../assets/panels.js") },
    Asset { path: "/settings.js", content_type: SCRIPT, body: include_str!("../../assets/settings.js") },
];

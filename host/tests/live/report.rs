//! The report of a drive as its reader meets it: in a real browser, from a file, without a network, on a screen and on paper. Skips, and says so, where
//! no chromium is installed.

use std::fs;
use std::path::Path;

use crossfall::capture::{Reader, Writer};
use crossfall::drive::Drive;
use crossfall::simulate::scene::Scene;
use crossfall::{log, report, run, simulate};
use crossfall_core::protocol::Config;
use serde_json::json;

use crate::devtools::Page;

/// The report of ten seconds of the default scene.
fn write_report(folder: &Path) -> String {
    let (capture, to, page) = (folder.join("a.mcap"), folder.join("a.log.mcap"), folder.join("drive.html"));
    let mut scene = Scene::default();
    scene.drive.seconds = 10.0;
    let mut writer = Writer::create(&capture).unwrap();
    simulate::simulate(&scene, &mut writer, |_| ()).unwrap();
    writer.finish().unwrap();
    let mut writer = log::Writer::create(&to).unwrap();
    run::run(&mut Reader::open(&capture).unwrap(), &Config::default(), &mut writer, |_| ()).unwrap();
    writer.finish().unwrap();
    fs::write(&page, report::page(&Drive::read(&to, |_| ()).unwrap(), "Ten seconds")).unwrap();
    format!("file://{}", page.display())
}

/// Lightness of the paper, 0 to 765.
const PAPER: &str =
    "getComputedStyle(document.body).backgroundColor.match(/\\d+/g).slice(0, 3).reduce((a, b) => a + Number(b), 0)";

fn key(page: &mut Page, key: &str) {
    for kind in ["rawKeyDown", "keyUp"] {
        page.call("Input.dispatchKeyEvent", json!({ "type": kind, "key": key, "code": key }));
    }
}

#[test]
fn a_reader_follows_the_road_by_pointer_by_keys_and_on_the_map() {
    let Some(mut page) = Page::open() else {
        eprintln!("skipped: no chromium is installed");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    // Whatever the page asked a network for would fail, and be a complaint.
    page.call("Network.enable", json!({}));
    let nothing = json!({ "offline": true, "latency": 0, "downloadThroughput": -1, "uploadThroughput": -1 });
    page.call("Network.emulateNetworkConditions", nothing);
    page.screen(1240, 1000);
    page.go(&write_report(folder.path()));

    // Four slopes with their intervals, and a section, from the start.
    let values = page.text("#values");
    assert_eq!((values.matches('±').count(), values.contains("left adjacent −")), (4, true), "{values}");
    assert!(page.eval("document.querySelectorAll('#section .point').length").as_u64().unwrap() > 200);
    let first = page.text("#which");
    // By pointer.
    let strip = page.eval("(() => { const r = document.querySelector('#strips').getBoundingClientRect(); return [r.x + r.width * 0.8, r.y + 60]; })()");
    page.call("Input.dispatchMouseEvent", json!({ "type": "mouseMoved", "x": strip[0], "y": strip[1] }));
    page.until(&format!("document.querySelector('#which').textContent !== {first:?}"));
    let pointed = page.text("#values");
    assert_ne!(pointed, values);
    // By keys.
    page.eval("document.querySelector('#strips').focus()");
    key(&mut page, "ArrowRight");
    page.until(&format!("document.querySelector('#values').textContent !== {pointed:?}"));
    key(&mut page, "ArrowLeft");
    page.until(&format!("document.querySelector('#values').textContent === {pointed:?}"));
    // On the map, whose middle is not where the drive begins or ends.
    page.eval("document.querySelector('#map').scrollIntoView({ block: 'center' })");
    page.click("#map");
    page.until(&format!("document.querySelector('#values').textContent !== {pointed:?}"));
    page.picture("report");

    // By night it is dark; on paper it is light by night as well, and fills pages.
    assert!(page.eval(PAPER).as_f64().unwrap() > 700.0);
    page.night(true);
    assert!(page.eval(PAPER).as_f64().unwrap() < 150.0);
    page.picture("report-night");
    let print = json!({ "media": "print", "features": [{ "name": "prefers-color-scheme", "value": "dark" }] });
    page.call("Emulation.setEmulatedMedia", print);
    assert!(page.eval(PAPER).as_f64().unwrap() > 700.0, "ink is dear");
    let paper = page.call("Page.printToPDF", json!({ "printBackground": true }));
    assert!(paper["data"].as_str().unwrap().len() > 20_000);

    // A telephone shows it without being moved sideways.
    page.night(false);
    page.screen(400, 800);
    let [wide, screen] = ["document.documentElement.scrollWidth", "innerWidth"].map(|width| page.eval(width).as_u64());
    assert!(wide <= screen, "{wide:?} {screen:?}");
    assert!(page.complaints.is_empty(), "{:#?}", page.complaints);
}

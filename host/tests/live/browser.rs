//! The page as an operator meets it: in a real browser, by touch and by keys. Skips, and says so, where no chromium is installed
//! (`cargo xtask setup` installs it on Debian).

use std::thread;
use std::time::{Duration, Instant};

use crossfall::verify;

use crate::bench::{Bench, await_that, marker_labels};
use crate::devtools::Page;

/// The sizes that the page is made for: a laptop, and a tablet held upright.
const SCREENS: [(u32, u32); 2] = [(1280, 800), (800, 1280)];

fn page() -> Option<Page> {
    let page = Page::open();
    if page.is_none() {
        eprintln!("skipped: no chromium is installed");
    }
    page
}

fn open(page: &mut Page, bench: &Bench) {
    page.go(&format!("http://{}/", bench.address));
    page.until("window.crossfall && document.querySelector('#lamp-lidar.good')");
}

fn no_complaints(page: &Page) {
    assert!(page.complaints.is_empty(), "{:#?}", page.complaints);
}

#[test]
fn an_operator_records_a_drive_by_touch() {
    let Some(mut page) = page() else { return };
    let bench = Bench::on_capture(1.0);
    page.screen(1280, 800);
    open(&mut page, &bench);
    for lamp in ["ins", "pulse", "disk", "link"] {
        page.until(&format!("document.querySelector('#lamp-{lamp}.good')"));
    }
    page.until("document.querySelector('#numbers-left .figure').textContent.includes('°')");
    // Numbers move.
    for (what, selector) in [("roll", "#now-roll"), ("station", "#station"), ("section", "#numbers-left .figure")] {
        let before = page.text(selector);
        page.until(&format!("document.querySelector({selector:?}).textContent !== {before:?}"));
        println!("{what} moved from {before}");
    }
    page.until("Number(document.querySelector('#density').textContent.replace(',', '')) > 500");
    page.eval("document.querySelector('#drive').value = 'by touch'");
    page.click("#record");
    page.until(
        "document.querySelector('#record.on') && document.querySelector('#record-label').textContent === 'Stop'",
    );
    page.until("document.querySelector('#record-time').textContent === '0:02'");
    page.click("#mark");
    page.click(".mark-kind[data-label=bridge]");
    page.until("document.querySelectorAll('#markers li').length === 2");
    page.picture("recording");
    page.click("#record");
    page.until("document.querySelector('#record-size').textContent.startsWith('saved')");
    let log = bench.folder.path().join("by touch.log.mcap");
    await_that("the log is closed", || log.exists());
    let report = verify::verify(&log, |_| ()).unwrap();
    assert!(report.ok && report.profiles > 50, "{:?}", report.problems);
    assert_eq!(marker_labels(&log), ["", "bridge"]);
    no_complaints(&page);
}

#[test]
fn the_page_tells_what_a_recording_has_lost_in_the_words_of_the_server() {
    let Some(mut page) = page() else { return };
    let bench = Bench::on_capture(1.0);
    open(&mut page, &bench);
    let mut shown = |state: &str, wanted: &str| {
        // In one go: the server's next state changes it again.
        page.eval(&format!(
            "import('/panels.js').then((panels) => {{ panels.showRecording({state}); \
             window.shown = document.querySelector('#record-size').textContent; }})"
        ));
        page.until(&format!("window.shown === {wanted:?}"));
    };
    let idle = "recording: { phase: 'idle' }, last_recording: { seconds: 61, bytes: 2e6 }";
    shown(&format!("{{ {idle}, recording_amiss: ['3 frames lost', 'x'] }}"), "2.0 MB, 3 frames lost, x");
    shown(&format!("{{ {idle}, recording_amiss: [] }}"), "saved, 2.0 MB");
    let on = "recording: { phase: 'recording', seconds: 5, bytes: 3e6, name: 'a' }, last_recording: null";
    shown(&format!("{{ {on}, recording_amiss: ['1 byte lost'] }}"), "3.0 MB, 1 byte lost");
    shown(&format!("{{ {on}, recording_amiss: [] }}"), "3.0 MB");
    shown("{ recording: { phase: 'idle' }, last_recording: null, recording_amiss: [] }", "not recording");
}

#[test]
fn an_operator_without_a_pointer_does_the_same() {
    let Some(mut page) = page() else { return };
    let bench = Bench::on_capture(1.0);
    open(&mut page, &bench);
    // By Tab and Enter.
    for _ in 0..40 {
        if page.eval("document.activeElement.id") == "record" {
            break;
        }
        page.press("Tab");
    }
    assert_eq!(page.eval("document.activeElement.id"), "record", "Tab leads to the record button");
    assert!(page.eval("document.activeElement.matches(':focus-visible')") == true, "and shows it");
    page.press("Enter");
    page.until("document.querySelector('#record-label').textContent === 'Stop'");
    page.until("document.querySelector('#record-time').textContent !== '0:00'");
    // By single keys.
    page.press("m");
    page.press("4");
    page.until("document.querySelectorAll('#markers li').length === 2");
    page.press("r");
    page.until("document.querySelector('#record-size').textContent.startsWith('saved')");
    page.press("t");
    let theme = page.eval("document.documentElement.dataset.theme");
    page.press("t");
    assert_ne!(page.eval("document.documentElement.dataset.theme"), theme);
    page.press("s");
    page.until("document.querySelector('#settings').open && document.querySelectorAll('#config input').length > 10");
    // A value that cannot be is refused in words; the board's echo of one that can be is told.
    let offset = "document.querySelector('#config-scanner-mounting_offset_deg')";
    page.eval(&format!("{offset}.focus(), {offset}.select()"));
    page.press("9");
    page.press("9");
    page.press("Enter");
    page.until("document.querySelector('#config-words.wrong')?.textContent.includes('from -90 to 90')");
    page.eval(&format!("{offset}.focus(), {offset}.select()"));
    page.press("1");
    page.press("Enter");
    page.until("document.querySelector('#config-words.right')?.textContent.includes('echoed')");
    assert_eq!(page.eval(&format!("{offset}.value")), "1.0");
    page.picture("setup");
    page.press("Escape");
    page.until("!document.querySelector('#settings').open");
    let log = std::fs::read_dir(bench.folder.path()).unwrap().next().unwrap().unwrap().path();
    assert!(verify::verify(&log, |_| ()).unwrap().ok);
    assert_eq!(marker_labels(&log), ["", "works"]);
    no_complaints(&page);
}

#[test]
fn an_unplugged_board_is_seen_and_its_return_too() {
    let Some(mut page) = page() else { return };
    let bench = Bench::on_board();
    page.screen(1280, 800);
    open(&mut page, &bench);
    let board = bench.board.as_ref().unwrap();
    board.unplug();
    page.until("document.querySelector('#lamp-link.bad')");
    assert!(page.text("#lamp-link span").contains("no connection"));
    page.until("document.querySelector('#notice').textContent.includes('cable')");
    page.until("!document.querySelector('#stale').hidden");
    page.picture("unplugged");
    board.plug_in();
    for lamp in ["link", "lidar", "ins", "pulse"] {
        page.until(&format!("document.querySelector('#lamp-{lamp}.good')"));
    }
    page.until("document.querySelector('#notice').textContent === '' && document.querySelector('#stale').hidden");
    no_complaints(&page);
}

/// What the operator must never have to look for.
const ALWAYS_THERE: &str = "['#record', '#record-time', '#lamps', '#lamp-lidar', '#lamp-link', '#section', '#numbers-left', '#numbers-right',
    '#chart-roll', '#chart-left', '#chart-right', '#track', '#speed', '#density', '#mark', '#fault', '#counters', '#open-settings', '#seek']";

#[test]
fn everything_fits_and_can_be_read_by_day_and_by_night() {
    let Some(mut page) = page() else { return };
    for (width, height) in SCREENS {
        for night in [false, true] {
            // A film of its own: none must end before it has been looked at.
            let bench = Bench::on_log(1.0);
            page.screen(width, height);
            page.night(night);
            open(&mut page, &bench);
            page.until("document.querySelector('#numbers-left .figure').textContent.includes('°')");
            let theme = if night { "dark" } else { "light" };
            assert_eq!(page.eval("document.documentElement.dataset.theme"), theme);
            let hidden = page.eval(&format!(
                "{ALWAYS_THERE}.filter((s) => {{ const r = document.querySelector(s).getBoundingClientRect();
                   return r.width < 8 || r.height < 8 || r.left < 0 || r.top < 0 || r.right > innerWidth + 1 || r.bottom > innerHeight + 1; }})"
            ));
            assert_eq!(hidden.as_array().map(Vec::len), Some(0), "{width}x{height} {theme}: {hidden}");
            let small = page.eval(
                "[...document.querySelectorAll('button')].filter((b) => b.offsetParent && !b.closest('dialog'))
                 .filter((b) => b.getBoundingClientRect().height < 44).map((b) => b.id)",
            );
            assert_eq!(small.as_array().map(Vec::len), Some(0), "touch targets {width}x{height}: {small}");
            // Contrast after WCAG 2: 4.5 for text, and far more for what is read at arm's length.
            let contrast = page.eval(CONTRAST);
            for (name, ratio) in contrast.as_object().unwrap() {
                let least = if name.starts_with("--ink") { 12.0 } else { 4.5 };
                assert!(ratio.as_f64().unwrap() >= least, "{theme} {name}: {ratio}");
            }
            page.picture(&format!("{width}x{height}-{theme}"));
        }
    }
    no_complaints(&page);
}

#[test]
fn on_a_phone_all_can_be_scrolled_to_and_nothing_lies_on_anything() {
    let Some(mut page) = page() else { return };
    let bench = Bench::on_log(1.0);
    page.screen(390, 844);
    open(&mut page, &bench);
    let outside = page.eval(
        "[...document.querySelectorAll('main canvas, main button, main .figure')].filter((e) => {
           const r = e.getBoundingClientRect(), card = e.closest('.card').getBoundingClientRect();
           return r.height < 8 || r.top < card.top || r.bottom > card.bottom || r.left < 0 || r.right > innerWidth; }).map((e) => e.id || e.textContent)",
    );
    assert_eq!(outside.as_array().map(Vec::len), Some(0), "beyond their cards: {outside}");
    let cards = page.eval(
        "[...document.querySelectorAll('main > .card')].map((e) => e.getBoundingClientRect()).map((r) => [r.top, r.bottom])",
    );
    for pair in cards.as_array().unwrap().windows(2) {
        assert!(pair[0][1].as_f64() <= pair[1][0].as_f64(), "cards lie on each other: {cards}");
    }
    page.picture("390x844");
    no_complaints(&page);
}

#[test]
fn a_screen_reader_hears_lamps_that_change_and_no_running_figures() {
    let Some(mut page) = page() else { return };
    let bench = Bench::on_board();
    open(&mut page, &bench);
    let live = page.eval("[...document.querySelectorAll('output, [aria-live], [role=status]')].filter((e) => !e.closest('dialog')).map((e) => e.id)");
    assert_eq!(live, serde_json::json!(["lamps-told", "notice"]));
    let unnamed = page.eval("[...document.querySelectorAll('canvas')].filter((e) => e.getAttribute('role') !== 'img' || !e.ariaLabel).map((e) => e.id)");
    assert_eq!(unnamed.as_array().map(Vec::len), Some(0), "canvases without a name: {unnamed}");
    bench.board.as_ref().unwrap().unplug();
    page.until("document.querySelector('#lamps-told').textContent.includes('Link: red, no connection')");
    no_complaints(&page);
}

const CONTRAST: &str = "(() => {
  const style = getComputedStyle(document.documentElement);
  const light = (name) => {
    const hex = style.getPropertyValue(name).trim();
    const [r, g, b] = [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255).map((v) => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const ratio = (a, b) => { const [x, y] = [light(a), light(b)].sort((m, n) => n - m); return (x + 0.05) / (y + 0.05); };
  const pairs = [['--ink', '--card'], ['--dim', '--card'], ['--good', '--card'], ['--warn', '--card'], ['--bad', '--card'], ['--adjacent', '--card'], ['--opposing', '--card'], ['--on', '--alarm']];
  return Object.fromEntries(pairs.map(([a, b]) => [`${a} on ${b}`, ratio(a, b)]));
})()";

/// Minutes of the long test: an hour of driving at ten times its speed.
const LONG: (f64, f64) = (3_600.0, 10.0);

/// Resident memory of this process in MiB, server included.
#[cfg(target_os = "linux")]
fn memory_mib() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmRSS:")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse::<u64>().unwrap() / 1024
}

#[test]
#[cfg(target_os = "linux")]
fn an_hour_at_ten_times_its_speed_loses_nothing() {
    if std::env::var_os("CROSSFALL_LONG").is_none() {
        eprintln!("skipped: takes nine minutes, `cargo xtask test --long` runs it");
        return;
    }
    let (Some(mut a), Some(mut b)) = (page(), page()) else { return };
    let (seconds, speed) = LONG;
    let bench = Bench::on_long_drive(seconds, speed);
    for page in [&mut a, &mut b] {
        page.screen(1280, 800);
        open(page, &bench);
    }
    a.eval("document.querySelector('#drive').value = 'hour'");
    a.click("#record");
    a.until("document.querySelector('#record-label').textContent === 'Stop'");
    let (mut rates, mut memory) = (Vec::new(), Vec::new());
    let began = Instant::now();
    while a.eval("document.querySelector('#play').textContent") != "Again" {
        assert!(began.elapsed().as_secs_f64() < 1.5 * seconds / speed, "{}", a.text("#place"));
        thread::sleep(Duration::from_secs(5));
        for page in [&mut a, &mut b] {
            let measured = page.eval("[window.crossfall.fps, window.crossfall.sections]");
            rates.push((measured[0].as_f64().unwrap(), measured[1].as_f64().unwrap()));
        }
        memory.push(memory_mib());
    }
    a.click("#record");
    a.until("document.querySelector('#record-size').textContent.startsWith('saved')");
    let report = verify::verify(&bench.folder.path().join("hour.log.mcap"), |_| ()).unwrap();
    rates.sort_by(|a, b| a.0.total_cmp(&b.0));
    let sections = rates.iter().map(|rate| rate.1).sum::<f64>() / rates.len() as f64;
    println!(
        "{} frames, {} profiles, {} missing, ok {}; pages: {:.0} frames/s at least, {:.0} in the median, {sections:.0} sections/s; memory {:?} MiB",
        report.frames,
        report.profiles,
        report.missing_frames,
        report.ok,
        rates[0].0,
        rates[rates.len() / 2].0,
        memory
    );
    assert!(report.ok && report.missing_frames == 0, "{:?}", report.problems);
    let (early, late) = (memory[memory.len() / 4], memory[memory.len() - 1]);
    assert!(late < early + 24, "memory grows: {memory:?}");
    no_complaints(&a);
    no_complaints(&b);
}

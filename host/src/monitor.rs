//! The live view for a terminal: the lamps, the section, the figures and the last fault, for who is connected by ssh.
//!
//! [`draw`] makes a picture of a [`State`] and a [`Section`] and does nothing else.

use ratatui::Frame;
use ratatui::layout::{Alignment, Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style, Stylize};
use ratatui::symbols::Marker;
use ratatui::text::{Line, Span};
use ratatui::widgets::canvas::{Canvas, Line as Stroke, Points};
use ratatui::widgets::{Block, Paragraph, Wrap};

use crate::live::{Lamp, Light, Phase, Piece, Section, State};

/// Metres to either side that are drawn when a section is narrow.
const LEAST_REACH_M: f64 = 8.0;

/// Draws everything.
pub fn draw(frame: &mut Frame<'_>, state: &State, section: Option<&Section>) {
    let [head, lamps, road, figures, fault, keys] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Length(5),
        Constraint::Min(6),
        Constraint::Length(5),
        Constraint::Length(2),
        Constraint::Length(1),
    ])
    .areas(frame.area());
    frame.render_widget(Paragraph::new(heading(state)), head);
    draw_lamps(frame, state, lamps);
    draw_section(frame, section, road);
    draw_figures(frame, state, section, figures);
    draw_fault(frame, state, fault);
    let replay = match &state.replay {
        None => "",
        Some(replay) if replay.ended => "  [space] again",
        Some(replay) if replay.paused => "  [space] play",
        Some(_) => "  [space] pause",
    };
    let words = format!("[r] record or stop  [m] mark{replay}  [q] quit");
    frame.render_widget(Paragraph::new(words).dim(), keys);
}

fn heading(state: &State) -> Line<'_> {
    let recording = &state.recording;
    let tape = match (&recording.phase, &state.last_recording) {
        (Phase::Idle, Some(last)) if !last.is_whole() => Span::from("log not whole").red().bold(),
        (Phase::Idle, Some(last)) => format!("saved {} ({:.1} MB)", last.name, last.bytes as f64 / 1e6).into(),
        (Phase::Idle, None) => "not recording".into(),
        _ => format!(
            "● REC {}:{:02}  {:.1} MB{}  {}",
            recording.seconds as u64 / 60,
            recording.seconds as u64 % 60,
            recording.bytes as f64 / 1e6,
            recording.lost.words().map(|lost| format!(", {lost}")).collect::<String>(),
            recording.name
        )
        .red()
        .bold(),
    };
    let board = state.board.as_ref().map_or("no board heard yet", |board| &board.board);
    let mut spans =
        vec!["crossfall  ".bold(), state.source.name.as_str().into(), "  ".into(), board.dim(), "   ".into(), tape];
    if let Some(replay) = &state.replay {
        let still = if replay.ended {
            ", ended"
        } else if replay.paused {
            ", paused"
        } else {
            ""
        };
        spans.push(format!("   {:.1} of {:.1} s, {}x{still}", replay.position_s, replay.length_s, replay.speed).dim());
    }
    Line::from(spans)
}

fn draw_lamps(frame: &mut Frame<'_>, state: &State, area: Rect) {
    let lamps = &state.lamps;
    let named = [
        ("LiDAR", &lamps.lidar),
        ("INS", &lamps.ins),
        ("Pulse", &lamps.pulse),
        ("Disk", &lamps.disk),
        ("Link", &lamps.link),
    ];
    let areas: [Rect; 5] = Layout::horizontal([Constraint::Ratio(1, 5); 5]).areas(area);
    for ((name, lamp), area) in named.into_iter().zip(areas) {
        let style = style_of(lamp);
        // A state is never told by colour alone.
        let sign = match lamp.light {
            Light::Off => "○",
            Light::Good => "●",
            Light::Warn => "▲",
            Light::Bad => "✖",
        };
        let block = Block::bordered().title(format!(" {sign} {name} ")).border_style(style).title_style(style.bold());
        frame.render_widget(Paragraph::new(lamp.words.as_str()).wrap(Wrap { trim: true }).block(block), area);
    }
}

fn style_of(lamp: &Lamp) -> Style {
    match lamp.light {
        Light::Off => Style::new().dark_gray(),
        Light::Good => Style::new().green(),
        Light::Warn => Style::new().yellow(),
        Light::Bad => Style::new().red().add_modifier(Modifier::REVERSED),
    }
}

fn draw_section(frame: &mut Frame<'_>, section: Option<&Section>, area: Rect) {
    let block =
        Block::bordered().title(" Section: left of the vehicle is left ").border_style(Style::new().dark_gray());
    let Some(section) = section else {
        return frame.render_widget(Paragraph::new("no scan yet").alignment(Alignment::Center).block(block), area);
    };
    let pieces: Vec<(&Piece, Color)> = section
        .sides
        .iter()
        .flat_map(|side| {
            [
                (side.road.as_ref(), Color::Gray),
                (side.adjacent.as_ref(), Color::Cyan),
                (side.opposing.as_ref(), Color::Magenta),
            ]
        })
        .filter_map(|(piece, colour)| Some((piece?, colour)))
        .collect();
    let ends = pieces.iter().flat_map(|(piece, _)| piece.ends.map(|(y, _)| f64::from(y.abs())));
    let reach = ends.fold(LEAST_REACH_M, f64::max) + 1.0;
    // Left positive in the data, on the left of the screen.
    let points: Vec<(f64, f64)> =
        section.points.iter().map(|&(y, z)| (f64::from(-y), f64::from(z))).filter(|(x, _)| x.abs() <= reach).collect();
    let (low, high) = points.iter().fold((-3.0_f64, -1.0_f64), |(low, high), &(_, z)| (low.min(z), high.max(z)));
    let canvas = Canvas::default()
        .block(block)
        .marker(Marker::Braille)
        .x_bounds([-reach, reach])
        .y_bounds([low - 0.3, high + 0.3])
        .paint(|context| {
            context.draw(&Points { coords: &points, color: Color::White });
            context.layer();
            for (piece, colour) in &pieces {
                let [(y1, z1), (y2, z2)] = piece.ends.map(|(y, z)| (f64::from(-y), f64::from(z)));
                context.draw(&Stroke { x1: y1, y1: z1, x2: y2, y2: z2, color: *colour });
            }
        });
    frame.render_widget(canvas, area);
}

fn draw_figures(frame: &mut Frame<'_>, state: &State, section: Option<&Section>, area: Rect) {
    let slope = |name: &str, piece: Option<&Piece>| match piece {
        Some(piece) if piece.ci95_deg.is_nan() => format!("{name} {:+.2}°", piece.slope_deg),
        Some(piece) => format!("{name} {:+.2}° ±{:.2}", piece.slope_deg, piece.ci95_deg),
        None => format!("{name} -"),
    };
    let mut lines = Vec::new();
    if let Some(section) = section {
        for (name, side) in ["Left ", "Right"].iter().zip(&section.sides) {
            lines.push(Line::from(vec![
                Span::from(format!("{name}  ")).bold(),
                Span::from(format!("{:<28}", slope("adjacent", side.adjacent.as_ref()))).cyan(),
                Span::from(format!("{:<28}", slope("opposing", side.opposing.as_ref()))).magenta(),
                Span::from(side.edge.map_or(String::new(), |(y, _)| format!("edge {:.2} m", y.abs()))),
            ]));
        }
        lines.push(Line::from(format!("Roll   {:+.2}°", section.roll_deg)));
    }
    let motion = &state.motion;
    let or_dash = |value: Option<f64>, digits: usize| value.map_or("-".to_owned(), |value| format!("{value:.digits$}"));
    if let Some(configuration) = &state.configuration {
        lines.push(Line::from(format!("With   {configuration}")).dim());
    }
    lines.push(Line::from(format!(
        "Speed  {} km/h   sections a mile {}   station {} km   markers {}",
        or_dash(motion.speed_m_s.map(|speed| speed * 3.6), 1),
        or_dash(motion.points_per_mile, 0),
        or_dash(motion.station_m.map(|station| station / 1e3), 2),
        state.marker_count
    )));
    frame.render_widget(Paragraph::new(lines), area);
}

fn draw_fault(frame: &mut Frame<'_>, state: &State, area: Rect) {
    let lamps = &state.lamps;
    let worst =
        [&lamps.link, &lamps.lidar, &lamps.ins, &lamps.pulse, &lamps.disk].into_iter().max_by_key(|lamp| lamp.light);
    let lines = match (worst.filter(|lamp| lamp.light == Light::Bad), state.faults.first()) {
        (Some(lamp), _) => vec![Line::from(lamp.words.as_str()).red().bold(), Line::from(lamp.advice)],
        (None, Some(fault)) => {
            vec![
                Line::from(format!("{} ({} s ago)", fault.words, fault.seconds_ago)).yellow(),
                Line::from(fault.advice),
            ]
        }
        (None, None) => vec![Line::from("No fault so far.").dim()],
    };
    frame.render_widget(Paragraph::new(lines), area);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::{Lamps, SideView};
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    fn picture(state: &State, section: Option<&Section>, width: u16, height: u16) -> String {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        terminal.draw(|frame| draw(frame, state, section)).unwrap();
        let buffer = terminal.backend().buffer();
        let rows = buffer.content.chunks(usize::from(width));
        rows.map(|row| row.iter().map(|cell| cell.symbol()).collect::<String>()).collect::<Vec<_>>().join("\n")
    }

    fn section() -> Section {
        let piece = Piece { slope_deg: -8.25, ci95_deg: 0.11, points: 30, ends: [(3.5, -2.4), (8.0, -3.0)] };
        let left = SideView { adjacent: Some(piece), edge: Some((3.5, 0.02)), ..SideView::default() };
        let points = (-100..100).map(|i| (i as f32 * 0.1, -2.4)).collect();
        Section { roll_deg: 1.5, sides: [left, SideView::default()], points, ..Section::default() }
    }

    #[test]
    fn lamps_slopes_and_faults_are_there_in_words() {
        let bad = Lamp { light: Light::Bad, words: "no scan for 4 s".into(), advice: "Check the supply." };
        let lamps = Lamps { lidar: bad, ..Lamps::default() };
        let told = picture(&State { lamps, ..State::default() }, Some(&section()), 100, 30);
        for words in [
            "✖ LiDAR",
            "○ INS",
            "no scan for 4 s",
            "Check the supply.",
            "adjacent -8.25° ±0.11",
            "edge 3.50 m",
            "[r] record",
        ] {
            assert!(told.contains(words), "{words} in\n{told}");
        }
        assert!(told.chars().any(|c| ('\u{2801}'..='\u{28ff}').contains(&c)), "points in\n{told}");
    }

    #[test]
    fn no_terminal_is_too_small() {
        for (width, height) in [(1, 1), (10, 3), (80, 24), (300, 90)] {
            picture(&State::default(), None, width, height);
            picture(&State::default(), Some(&section()), width, height);
        }
    }
}

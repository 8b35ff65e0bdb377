//! Text as a terminal may have it.
//!
//! Names and messages of a board or a file are anybody's bytes: an escape sequence among them would move the cursor, rename the window or worse.

use std::borrow::Cow;

/// The text with every control character but newline and tab made visible (`\u{1b}`).
pub fn visible(text: &str) -> Cow<'_, str> {
    let hidden = |c: char| c.is_control() && !matches!(c, '\n' | '\t');
    if !text.contains(hidden) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if hidden(c) { shown.extend(c.escape_default()) } else { shown.push(c) }
    }
    Cow::Owned(shown)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_shown_and_nothing_else_changes() {
        assert_eq!(visible("\x1b]0;name\x07\r\u{9b}2J\x7f"), r"\u{1b}]0;name\u{7}\r\u{9b}2J\u{7f}");
        let plain = "1.25\u{b0} \u{b1} 0.02\u{b0}\tnaïve 道路\n";
        assert!(matches!(visible(plain), Cow::Borrowed(same) if same == plain));
    }
}

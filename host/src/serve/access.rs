//! Who may look at all.
//!
//! On a loopback address anyone on this computer may, but a web page from elsewhere may not: a request must name this computer as its
//! host (so that a name that another server controls leads nowhere), and one that comes from a page must come from ours.
//! On any other address nothing is served without the token: as `Authorization: Bearer`, as a cookie, or once in the query of the
//! page's address, which sets the cookie.

use axum::http::{HeaderMap, Uri, header};

/// Name of the cookie that carries the token.
pub const COOKIE: &str = "crossfall";

/// Shortest token that is accepted, in characters.
const SHORTEST: usize = 16;

/// Whether a text can be a token: long enough, and letters and digits alone, as it stands in addresses and cookies.
#[must_use]
pub fn is_token(text: &str) -> bool {
    text.len() >= SHORTEST && text.bytes().all(|byte| byte.is_ascii_alphanumeric())
}

/// What is asked of a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Access {
    /// It must come from this computer, and not from another site's page.
    ThisComputer,
    /// It must have this token.
    Token(String),
}

/// What a request is told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It may.
    Granted,
    /// It may, and brought the token in its query: the page is to be loaded again with the cookie.
    GrantedByQuery,
    /// It has no token, or another.
    NoToken,
    /// It names another host, or comes from another site's page.
    Foreign,
}

impl Access {
    /// Judges a request.
    #[must_use]
    pub fn judge(&self, uri: &Uri, headers: &HeaderMap) -> Verdict {
        let text = |name| headers.get(name).and_then(|value| value.to_str().ok());
        let host = text(header::HOST);
        // A page's own requests name its own host; no page elsewhere may use a viewer's cookie.
        let same_site = match (text(header::ORIGIN), host) {
            (None, _) => headers.get(header::ORIGIN).is_none(),
            (Some(origin), Some(host)) => origin.split_once("://").is_some_and(|(_, from)| from == host),
            (Some(_), None) => false,
        };
        if !same_site {
            return Verdict::Foreign;
        }
        match self {
            Self::ThisComputer if host.is_some_and(is_loopback) => Verdict::Granted,
            Self::ThisComputer => Verdict::Foreign,
            Self::Token(token) => {
                let bearer = text(header::AUTHORIZATION).and_then(|value| value.strip_prefix("Bearer "));
                let cookies = headers.get_all(header::COOKIE).into_iter().filter_map(|value| value.to_str().ok());
                let cookie = cookies
                    .flat_map(|value| value.split(';'))
                    .find_map(|pair| pair.trim().strip_prefix(COOKIE)?.strip_prefix('='));
                let query = uri.query().and_then(|query| query.split('&').find_map(|pair| pair.strip_prefix("token=")));
                let is = |given: Option<&str>| given.is_some_and(|given| equal(given, token));
                if is(bearer) || is(cookie) {
                    Verdict::Granted
                } else if is(query) {
                    Verdict::GrantedByQuery
                } else {
                    Verdict::NoToken
                }
            }
        }
    }
}

/// Whether a `Host` header names this computer.
fn is_loopback(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|byte| byte.is_ascii_digit()) => name,
        _ => host,
    };
    name.eq_ignore_ascii_case("localhost")
        || name == "[::1]"
        || name.parse::<std::net::Ipv4Addr>().is_ok_and(|address| address.is_loopback())
}

/// Compares in a time that tells nothing but the lengths.
fn equal(given: &str, token: &str) -> bool {
    let differing = given.bytes().zip(token.bytes()).fold(0, |all, (a, b)| all | (a ^ b));
    given.len() == token.len() && differing == 0
}

/// A token of 128 random bits, in hexadecimal.
///
/// # Errors
/// When the system has no random numbers.
pub fn random_token() -> Result<String, getrandom::Error> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;

    fn judge(access: &Access, uri: &str, given: &[(header::HeaderName, &'static str)]) -> Verdict {
        let mut headers = HeaderMap::new();
        for (name, value) in given {
            headers.append(name, HeaderValue::from_static(value));
        }
        access.judge(&uri.parse().unwrap(), &headers)
    }

    #[test]
    fn on_loopback_only_this_computer_and_its_own_page_are_served() {
        let judge = |given: &[_]| judge(&Access::ThisComputer, "/", given);
        for host in ["localhost:8080", "127.0.0.1:8080", "127.0.0.1", "[::1]:8080", "LOCALHOST"] {
            assert_eq!(judge(&[(header::HOST, host)]), Verdict::Granted, "{host}");
        }
        for host in ["evil.example", "127.0.0.1.evil.example:80", "10.0.0.1:8080", ""] {
            assert_eq!(judge(&[(header::HOST, host)]), Verdict::Foreign, "{host}");
        }
        assert_eq!(judge(&[]), Verdict::Foreign);
        let local = (header::HOST, "localhost:8080");
        assert_eq!(judge(&[local.clone(), (header::ORIGIN, "http://localhost:8080")]), Verdict::Granted);
        assert_eq!(judge(&[local.clone(), (header::ORIGIN, "http://localhost:9999")]), Verdict::Foreign);
        assert_eq!(judge(&[local, (header::ORIGIN, "null")]), Verdict::Foreign);
    }

    #[test]
    fn elsewhere_nothing_goes_without_the_token() {
        let access = Access::Token("0123456789abcdef".into());
        let host = (header::HOST, "10.0.0.1:8080");
        let judge = |uri, more: &[_]| {
            let given: Vec<_> = std::iter::once(host.clone()).chain(more.iter().cloned()).collect();
            judge(&access, uri, &given)
        };
        assert_eq!(judge("/", &[]), Verdict::NoToken);
        assert_eq!(judge("/?token=0123456789abcdef", &[]), Verdict::GrantedByQuery);
        assert_eq!(judge("/?token=0123456789abcdeF", &[]), Verdict::NoToken);
        assert_eq!(judge("/?token=", &[]), Verdict::NoToken);
        let bearer = |value| [(header::AUTHORIZATION, value)];
        assert_eq!(judge("/", &bearer("Bearer 0123456789abcdef")), Verdict::Granted);
        assert_eq!(judge("/", &bearer("Bearer 0123456789abcde")), Verdict::NoToken);
        assert_eq!(judge("/", &bearer("Basic 0123456789abcdef")), Verdict::NoToken);
        let cookie = |value| [(header::COOKIE, value)];
        assert_eq!(judge("/", &cookie("a=b; crossfall=0123456789abcdef")), Verdict::Granted);
        assert_eq!(judge("/", &cookie("crossfall2=0123456789abcdef")), Verdict::NoToken);
        let elsewhere = [(header::COOKIE, "crossfall=0123456789abcdef"), (header::ORIGIN, "http://evil.example")];
        assert_eq!(judge("/", &elsewhere), Verdict::Foreign);
    }

    #[test]
    fn tokens_are_long_and_differ() {
        let (a, b) = (random_token().unwrap(), random_token().unwrap());
        assert!(is_token(&a) && is_token(&b) && a != b);
        assert!(!is_token("short") && !is_token("0123456789abcdef; x=1"));
    }
}

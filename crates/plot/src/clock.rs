//! Wall-clock times as text, in UTC. Durations are measured by [`std::time::Instant`] instead: it does
//! not follow changes of the clock and stands still while the machine sleeps.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Start of the year 10000, since 1970.
const YEAR_10000: Duration = Duration::from_secs(253_402_300_800);

/// Date and time of day, to the minute; `None` before 1970 and from the year 10000 on.
pub fn date(time: SystemTime) -> Option<String> {
    let Moment { day, time, .. } = Moment::of(time)?;
    let ([year, month, day], [hour, minute, _]) = (day, time);
    Some(format!(
        "{year}-{month:02}-{day:02} {hour:02}:{minute:02} UTC"
    ))
}

/// Date and time of day in ISO 8601, to the millisecond; 1970-01-01 before 1970 and from the year
/// 10000 on.
pub fn stamp(time: SystemTime) -> String {
    let Moment { day, time, millis } = Moment::of(time).unwrap_or_default();
    let ([year, month, day], [hour, minute, second]) = (day, time);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}.{millis:03}Z")
}

struct Moment {
    /// Year, month, day.
    day: [u64; 3],
    /// Hour, minute, second.
    time: [u64; 3],
    millis: u32,
}

impl Default for Moment {
    fn default() -> Self {
        Self {
            day: [1970, 1, 1],
            time: [0; 3],
            millis: 0,
        }
    }
}

impl Moment {
    fn of(time: SystemTime) -> Option<Self> {
        let since = time.duration_since(UNIX_EPOCH).ok()?;
        // A file's owner can set any time.
        let since = Some(since).filter(|since| *since < YEAR_10000)?;
        let seconds = since.as_secs();
        Some(Self {
            day: civil(seconds / 86_400),
            time: [seconds / 3600 % 24, seconds / 60 % 60, seconds % 60],
            millis: since.subsec_millis(),
        })
    }
}

/// Year, month and day of a number of days since 1970.
fn civil(mut days: u64) -> [u64; 3] {
    let leap = |year: u64| {
        year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400))
    };
    let mut year = 1970;
    loop {
        let length = if leap(year) { 366 } else { 365 };
        if days < length {
            break;
        }
        days -= length;
        year += 1;
    }
    let february = if leap(year) { 29 } else { 28 };
    let lengths = [31, february, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    let mut month = 1;
    for length in lengths {
        if days < length {
            break;
        }
        days -= length;
        month += 1;
    }
    [year, month, days + 1]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        let text = |seconds| date(UNIX_EPOCH + Duration::from_secs(seconds)).unwrap();
        assert_eq!(text(0), "1970-01-01 00:00 UTC");
        assert_eq!(text(951_782_399), "2000-02-28 23:59 UTC");
        assert_eq!(text(951_782_400), "2000-02-29 00:00 UTC");
        assert_eq!(text(951_868_800), "2000-03-01 00:00 UTC");
        assert_eq!(text(1_798_761_599), "2026-12-31 23:59 UTC");
        assert_eq!(text(253_402_300_799), "9999-12-31 23:59 UTC");
        assert_eq!(date(UNIX_EPOCH + YEAR_10000), None);
        assert_eq!(date(UNIX_EPOCH - Duration::from_secs(1)), None);
    }

    #[test]
    fn stamps_are_of_one_length_and_in_order() {
        let text = |millis| stamp(UNIX_EPOCH + Duration::from_millis(millis));
        assert_eq!(text(951_782_399_007), "2000-02-28T23:59:59.007Z");
        assert_eq!(text(0), "1970-01-01T00:00:00.000Z");
        assert_eq!(stamp(UNIX_EPOCH - Duration::from_secs(1)), text(0));
    }
}

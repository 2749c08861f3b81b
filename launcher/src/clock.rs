//! Moments of wall-clock time as people read them, in UTC. For nothing else: what is measured is
//! measured by [`std::time::Instant`], which no change of the clock moves and which stands still
//! while the machine sleeps.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Since 1970.
const YEAR_10000: Duration = Duration::from_secs(253_402_300_800);

/// Day and time of day, to the minute.
pub(crate) fn date(time: SystemTime) -> Option<String> {
    let Moment { day, time, .. } = Moment::of(time)?;
    let ([year, month, day], [hour, minute, _]) = (day, time);
    Some(format!(
        "{year}-{month:02}-{day:02} {hour:02}:{minute:02} UTC"
    ))
}

/// The same to the millisecond, by ISO 8601. What lies outside of its years is their beginning.
pub(crate) fn stamp(time: SystemTime) -> String {
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
        // A file can be dated as its owner likes.
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
        let told = |seconds| date(UNIX_EPOCH + Duration::from_secs(seconds)).unwrap();
        assert_eq!(told(0), "1970-01-01 00:00 UTC");
        assert_eq!(told(951_782_399), "2000-02-28 23:59 UTC");
        assert_eq!(told(951_782_400), "2000-02-29 00:00 UTC");
        assert_eq!(told(951_868_800), "2000-03-01 00:00 UTC");
        assert_eq!(told(1_798_761_599), "2026-12-31 23:59 UTC");
        assert_eq!(told(253_402_300_799), "9999-12-31 23:59 UTC");
        assert_eq!(date(UNIX_EPOCH + YEAR_10000), None);
        assert_eq!(date(UNIX_EPOCH - Duration::from_secs(1)), None);
    }

    #[test]
    fn stamps_are_of_one_length_and_in_order() {
        let told = |millis| stamp(UNIX_EPOCH + Duration::from_millis(millis));
        assert_eq!(told(951_782_399_007), "2000-02-28T23:59:59.007Z");
        assert_eq!(told(0), "1970-01-01T00:00:00.000Z");
        assert_eq!(stamp(UNIX_EPOCH - Duration::from_secs(1)), told(0));
    }
}

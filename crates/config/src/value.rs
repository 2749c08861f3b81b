//! Types that a key's value can have.

use toml::de::DeValue;

use crate::fault::shown;

/// Whole numbers from here on are not told apart as floating-point numbers.
const EXACT: f64 = 9_007_199_254_740_992.0;

/// A type that a key's value can have.
pub(crate) trait Value: Clone {
    /// What it is called in a fault.
    const NAME: &'static str;

    /// Reads it, or says what was found instead.
    fn read(value: &DeValue<'_>) -> Result<Self, String>;

    /// The same of a value on the command line, which is `raw` as typed.
    fn read_set(value: &DeValue<'_>, _raw: &str) -> Result<Self, String> {
        Self::read(value)
    }

    fn write(&self) -> String;
}

/// A whole number, which may be written as in `1e6`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Whole(pub(crate) i128);

impl Value for Whole {
    const NAME: &'static str = "a whole number";
    fn read(value: &DeValue<'_>) -> Result<Self, String> {
        match value {
            DeValue::Integer(integer) => {
                let digits = integer.as_str();
                let whole = i128::from_str_radix(digits, integer.radix());
                whole.map(Self).map_err(|_| too_large(digits))
            }
            DeValue::Float(float) => match float.as_str().parse::<f64>() {
                Ok(number) if number.abs() > EXACT && is_huge(value) => {
                    Err(too_large(float.as_str()))
                }
                Ok(number) if number.is_finite() && number.fract() == 0.0 => {
                    Ok(Self(number as i128))
                }
                _ => Err(misfit::<Self>(value)),
            },
            _ => Err(misfit::<Self>(value)),
        }
    }
    fn write(&self) -> String {
        self.0.to_string()
    }
}

impl Value for f64 {
    const NAME: &'static str = "a number";
    fn read(value: &DeValue<'_>) -> Result<Self, String> {
        let number = match value {
            DeValue::Float(float) => float.as_str().parse::<Self>().ok(),
            DeValue::Integer(_) => Whole::read(value).ok().map(|whole| whole.0 as Self),
            _ => return Err(misfit::<Self>(value)),
        };
        match number {
            // Without the sign of a zero.
            Some(number) if number.is_finite() => Ok(number + 0.0),
            _ if is_huge(value) => Err(too_large(&digits(value))),
            _ => Err(format!(
                "expected a finite number, found {}",
                describe(value)
            )),
        }
    }
    fn write(&self) -> String {
        format!("{self:?}")
    }
}

impl Value for bool {
    const NAME: &'static str = "true or false";
    fn read(value: &DeValue<'_>) -> Result<Self, String> {
        value.as_bool().ok_or_else(|| match value.as_str() {
            Some(text) => match flag(text) {
                Some(flag) => format!(
                    "expected true or false, found the text \"{text}\"; did you mean {flag}?"
                ),
                None => misfit::<Self>(value),
            },
            None => misfit::<Self>(value),
        })
    }
    fn write(&self) -> String {
        self.to_string()
    }
}

impl Value for String {
    const NAME: &'static str = "a text in quotes";
    fn read(value: &DeValue<'_>) -> Result<Self, String> {
        let text = value.as_str().map(str::to_owned);
        text.ok_or_else(|| misfit::<Self>(value))
    }
    fn read_set(value: &DeValue<'_>, raw: &str) -> Result<Self, String> {
        // 2024-05-01 is as good a text as any.
        Ok(value.as_str().unwrap_or(raw).to_owned())
    }
    fn write(&self) -> String {
        toml::Value::String(self.clone()).to_string()
    }
}

impl<T: Value> Value for Vec<T> {
    const NAME: &'static str = "a list";
    fn read(value: &DeValue<'_>) -> Result<Self, String> {
        let items = value.as_array().ok_or_else(|| misfit::<Self>(value))?;
        items
            .iter()
            .enumerate()
            .map(|(i, item)| {
                T::read(item.get_ref())
                    .map_err(|told| format!("item {} of the list: {told}", i + 1))
            })
            .collect()
    }
    fn write(&self) -> String {
        let items: Vec<String> = self.iter().map(Value::write).collect();
        format!("[{}]", items.join(", "))
    }
}

/// What a word that other languages have for it means.
pub(crate) fn flag(word: &str) -> Option<bool> {
    match word.to_ascii_lowercase().as_str() {
        "true" | "yes" | "on" => Some(true),
        "false" | "no" | "off" => Some(false),
        _ => None,
    }
}

fn misfit<T: Value>(value: &DeValue<'_>) -> String {
    format!("expected {}, found {}", T::NAME, describe(value))
}

fn digits(value: &DeValue<'_>) -> String {
    match value {
        DeValue::Integer(integer) => integer.as_str().to_owned(),
        DeValue::Float(float) => float.as_str().to_owned(),
        _ => String::new(),
    }
}

/// Whether it is a number written out that is beyond what can be held.
fn is_huge(value: &DeValue<'_>) -> bool {
    digits(value).contains(|c: char| c.is_ascii_digit())
}

fn too_large(digits: &str) -> String {
    format!("{} is too large a number", shown(digits))
}

fn describe(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) => format!("the text \"{}\"", shown(text)),
        DeValue::Integer(integer) => format!("the whole number {}", shown(integer.as_str())),
        DeValue::Float(float) if !is_huge(value) => float.as_str().to_owned(),
        DeValue::Float(float) => format!("the number {}", shown(float.as_str())),
        DeValue::Boolean(boolean) => boolean.to_string(),
        DeValue::Datetime(date) => format!("the date {date}"),
        DeValue::Array(_) => "a list".to_owned(),
        DeValue::Table(_) => "a table".to_owned(),
    }
}

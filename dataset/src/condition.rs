//! Which materials are meant, said by their labels: `roughness < 20 and split == 'train'`.
//!
//! ```text
//! condition  = all { "or" all }
//! all        = one { "and" one }
//! one        = "not" one | "(" condition ")" | comparison
//! comparison = value ( "<" | "<=" | ">" | ">=" | "==" | "!=" ) value
//! value      = number | text in single or double quotes | label
//! ```
//!
//! Labels have the names of the manifest's columns, as its CSV form has them: a colour's red is
//! `rgb0_linear_0`.

use crate::{SampledMaterial, Split};
use std::{
    cmp::Ordering,
    fmt::{self, Display, Formatter},
    str::FromStr,
};

/// How deep conditions may be nested.
const DEPTH_MAX: usize = 32;

/// The labels of one number each.
const NUMBERS: [&str; 5] = ["material", "roughness", "anisotropy", "angle_deg", "ior"];

/// The labels of three numbers each, `_0` to `_2`.
const TRIPLES: [&str; 6] = [
    "rgb0_linear",
    "rgb90_linear",
    "rgb0_srgb",
    "rgb90_srgb",
    "rgb0_lab",
    "rgb90_lab",
];

/// A condition on a material's labels.
#[derive(Clone, Debug, PartialEq)]
pub struct Condition {
    text: String,
    expression: Expression,
}

#[derive(Clone, Debug, PartialEq)]
enum Expression {
    Any(Vec<Expression>),
    All(Vec<Expression>),
    Not(Box<Expression>),
    Compare(Value, Relation, Value),
}

#[derive(Clone, Debug, PartialEq)]
enum Value {
    Number(f64),
    Text(String),
    // Index into NUMBERS.
    Label(usize),
    // Indices into TRIPLES and into the three numbers.
    Part(usize, usize),
    Split,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Relation {
    Less,
    AtMost,
    More,
    AtLeast,
    Equal,
    Unequal,
}

impl Condition {
    /// Whether it holds for a material of a set.
    pub fn holds(&self, material: &SampledMaterial, split: Split) -> bool {
        self.expression.holds(material, split)
    }
}

impl Expression {
    fn holds(&self, material: &SampledMaterial, split: Split) -> bool {
        let holds = |expression: &Self| expression.holds(material, split);
        match self {
            Self::Any(of) => of.iter().any(holds),
            Self::All(of) => of.iter().all(holds),
            Self::Not(expression) => !holds(expression),
            Self::Compare(left, relation, right) => {
                if let (Some(left), Some(right)) = (left.text(split), right.text(split)) {
                    relation.holds(left.cmp(right))
                } else {
                    let [left, right] = [left, right].map(|value| value.number(material));
                    left.partial_cmp(&right)
                        .is_some_and(|order| relation.holds(order))
                }
            }
        }
    }
}

impl Value {
    fn is_text(&self) -> bool {
        matches!(self, Self::Text(_) | Self::Split)
    }

    fn text(&self, split: Split) -> Option<&str> {
        match self {
            Self::Text(text) => Some(text),
            Self::Split => Some(split.name()),
            _ => None,
        }
    }

    fn number(&self, sampled: &SampledMaterial) -> f64 {
        let material = &sampled.material;
        match self {
            Self::Number(number) => *number,
            Self::Label(label) => [
                f64::from(sampled.index),
                material.roughness,
                material.anisotropy,
                material.angle_deg,
                material.ior,
            ][*label],
            Self::Part(triple, part) => match triple {
                0 => material.rgb0[*part],
                1 => material.rgb90[*part],
                2 => sampled.srgb0[*part],
                3 => sampled.srgb90[*part],
                4 => sampled.lab0()[*part],
                _ => sampled.lab90()[*part],
            },
            Self::Text(_) | Self::Split => f64::NAN,
        }
    }
}

impl Relation {
    fn holds(self, order: Ordering) -> bool {
        match self {
            Self::Less => order.is_lt(),
            Self::AtMost => order.is_le(),
            Self::More => order.is_gt(),
            Self::AtLeast => order.is_ge(),
            Self::Equal => order.is_eq(),
            Self::Unequal => order.is_ne(),
        }
    }
}

impl Display for Condition {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl FromStr for Condition {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut reader = Reader {
            rest: text,
            depth: 0,
        };
        let expression = reader.condition()?;
        match reader.next()? {
            None => Ok(Self {
                text: text.split_whitespace().collect::<Vec<_>>().join(" "),
                expression,
            }),
            Some(token) => Err(format!(
                "{token} comes too late: `and` or `or` is missing before it"
            )),
        }
    }
}

/// A piece of a condition's text.
#[derive(Clone, Debug, PartialEq)]
enum Token<'a> {
    Word(&'a str),
    Quoted(&'a str),
    Sign(&'a str),
}

impl Display for Token<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Word(text) | Self::Sign(text) => write!(f, "`{text}`"),
            Self::Quoted(text) => write!(f, "'{text}'"),
        }
    }
}

struct Reader<'a> {
    rest: &'a str,
    depth: usize,
}

impl<'a> Reader<'a> {
    fn condition(&mut self) -> Result<Expression, String> {
        self.depth += 1;
        if self.depth > DEPTH_MAX {
            return Err(format!("it is nested more than {DEPTH_MAX} deep"));
        }
        let mut any = vec![self.all()?];
        while self.takes(&Token::Word("or"))? {
            any.push(self.all()?);
        }
        self.depth -= 1;
        Ok(Expression::Any(any))
    }

    fn all(&mut self) -> Result<Expression, String> {
        let mut all = vec![self.one()?];
        while self.takes(&Token::Word("and"))? {
            all.push(self.one()?);
        }
        Ok(Expression::All(all))
    }

    fn one(&mut self) -> Result<Expression, String> {
        let mut is_negated = false;
        while self.takes(&Token::Word("not"))? {
            is_negated = !is_negated;
        }
        let one = if self.takes(&Token::Sign("("))? {
            let inner = self.condition()?;
            if !self.takes(&Token::Sign(")"))? {
                return Err("a `)` is missing".to_owned());
            }
            inner
        } else {
            self.comparison()?
        };
        Ok(match is_negated {
            true => Expression::Not(Box::new(one)),
            false => one,
        })
    }

    fn comparison(&mut self) -> Result<Expression, String> {
        let left = self.value()?;
        let relation = match self.next()? {
            Some(Token::Sign("<")) => Relation::Less,
            Some(Token::Sign("<=")) => Relation::AtMost,
            Some(Token::Sign(">")) => Relation::More,
            Some(Token::Sign(">=")) => Relation::AtLeast,
            Some(Token::Sign("==")) => Relation::Equal,
            Some(Token::Sign("!=")) => Relation::Unequal,
            Some(Token::Sign("=")) => return Err("`=` compares nothing: write ==".to_owned()),
            Some(token) => return Err(format!("{token} is no comparison: <, <=, >, >=, == or !=")),
            None => return Err("a comparison is missing at its end".to_owned()),
        };
        let right = self.value()?;
        if left.is_text() != right.is_text() {
            return Err("a number and a text cannot be compared".to_owned());
        }
        match (&left, &right) {
            (Value::Text(_), Value::Text(_)) => {
                return Err("two texts are compared, and no label".to_owned());
            }
            (Value::Text(name), _) | (_, Value::Text(name)) => known_split(name)?,
            _ => {}
        }
        Ok(Expression::Compare(left, relation, right))
    }

    fn value(&mut self) -> Result<Value, String> {
        match self.next()? {
            Some(Token::Quoted(text)) => Ok(Value::Text(text.to_owned())),
            Some(Token::Word("split")) => Ok(Value::Split),
            Some(Token::Word(word)) => number(word)
                .or_else(|| label(word))
                .ok_or_else(|| unknown_label(word)),
            Some(token) => Err(format!("{token} is no value")),
            None => Err("a value is missing at its end".to_owned()),
        }
    }

    fn takes(&mut self, wanted: &Token<'_>) -> Result<bool, String> {
        let before = self.rest;
        let takes = self.next()?.as_ref() == Some(wanted);
        if !takes {
            self.rest = before;
        }
        Ok(takes)
    }

    fn next(&mut self) -> Result<Option<Token<'a>>, String> {
        self.rest = self.rest.trim_start();
        let Some(first) = self.rest.chars().next() else {
            return Ok(None);
        };
        if let quote @ ('\'' | '"') = first {
            let inside = &self.rest[1..];
            let end = inside.find(quote).ok_or("a quote is not closed")?;
            self.rest = &inside[end + 1..];
            return Ok(Some(Token::Quoted(&inside[..end])));
        }
        let of_a_word = |c: char| c.is_alphanumeric() || matches!(c, '_' | '.' | '+' | '-');
        let word = self.rest.find(|c| !of_a_word(c)).unwrap_or(self.rest.len());
        let (length, is_word) = match word {
            0 => {
                let is_long = ["<=", ">=", "==", "!="]
                    .iter()
                    .any(|sign| self.rest.starts_with(sign));
                (if is_long { 2 } else { first.len_utf8() }, false)
            }
            word => (word, true),
        };
        let (token, rest) = self.rest.split_at(length);
        self.rest = rest;
        Ok(Some(match is_word {
            true => Token::Word(token),
            false => Token::Sign(token),
        }))
    }
}

fn number(word: &str) -> Option<Value> {
    // Words such as `inf` and `nan` are read as numbers, too.
    let begins = word.trim_start_matches(['+', '-']);
    let is_number = begins.starts_with(|c: char| c.is_ascii_digit() || c == '.');
    let number = word.parse().ok().filter(|_| is_number)?;
    Some(Value::Number(number))
}

fn label(word: &str) -> Option<Value> {
    if let Some(place) = NUMBERS.iter().position(|name| *name == word) {
        return Some(Value::Label(place));
    }
    let (triple, part) = word.rsplit_once('_')?;
    let triple = TRIPLES.iter().position(|name| *name == triple)?;
    let part = ["0", "1", "2"].iter().position(|name| *name == part)?;
    Some(Value::Part(triple, part))
}

fn unknown_label(word: &str) -> String {
    format!(
        "`{word}` is no label: {}, split, or {} with _0, _1 or _2 (texts stand in quotes)",
        NUMBERS.join(", "),
        TRIPLES.join(", ")
    )
}

fn known_split(name: &str) -> Result<(), String> {
    let splits = [Split::Train, Split::Validation, Split::Test].map(Split::name);
    match splits.contains(&name) {
        true => Ok(()),
        false => Err(format!("there is no split '{name}': {}", splits.join(", "))),
    }
}

#[cfg(test)]
mod tests;

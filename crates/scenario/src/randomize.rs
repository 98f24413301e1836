//! What each seed draws.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::LoadError;
use crate::document::Document;
use crate::raw::{RawNormal, RawRandomize};
use crate::tree::{Node, Value};

/// A normal draw farther from the mean than this is drawn again.
const CUT_SIGMAS: f64 = 2.5;

/// One checked entry of `randomize`.
#[derive(Debug, Clone)]
pub(crate) struct Draw {
    pub key: String,
    law: Law,
}

#[derive(Debug, Clone)]
enum Law {
    Uniform(f64, f64),
    Choice(Vec<Node>),
    Normal(RawNormal),
}

/// Checks the entries against themselves; whether a key exists shows when a value is put there.
pub(crate) fn draws(document: &Document, raw: &[RawRandomize]) -> Result<Vec<Draw>, LoadError> {
    let mut draws: Vec<Draw> = Vec::new();
    for (index, entry) in raw.iter().enumerate() {
        let at = format!("randomize.{index}");
        let fail = |key: &str, message: &str| Err(document.fail(&format!("{at}.{key}"), message));
        if matches!(entry.key.split('.').next(), Some("seed" | "randomize" | "expect" | "name")) {
            return fail(
                "key",
                "must not be drawn: seed, name, randomize and expect are the same for every seed",
            );
        }
        if draws.iter().any(|draw| draw.key == entry.key) {
            return fail("key", "is drawn twice");
        }
        let law = match (entry.uniform, &entry.choice, entry.normal) {
            (Some([low, high]), None, None) if low <= high => Law::Uniform(low, high),
            (Some(_), None, None) => return fail("uniform", "must be [low, high] with low ≤ high"),
            (None, Some(_), None) => match document.tree.get(&format!("{at}.choice")).map(|node| &node.value)
            {
                Some(Value::List(items)) => Law::Choice(items.clone()),
                _ => return fail("choice", "must be a list"),
            },
            (None, None, Some(normal)) => Law::Normal(normal),
            _ => return fail("key", "must come with exactly one of the keys uniform, choice, normal"),
        };
        draws.push(Draw { key: entry.key.clone(), law });
    }
    Ok(draws)
}

impl Draw {
    /// The value that a seed draws. Every key has its own stream of random numbers, so that an entry more or less
    /// changes no other draw.
    pub fn value(&self, seed: u64) -> Node {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(fnv1a(&self.key));
        match &self.law {
            Law::Uniform(low, high) => float((low + (high - low) * unit(&mut rng)).clamp(*low, *high)),
            Law::Choice(items) => {
                let index = (unit(&mut rng) * items.len() as f64) as usize;
                items[index.min(items.len() - 1)].clone()
            }
            Law::Normal(normal) => float(normal.mean + normal.sigma * cut_normal(&mut rng)),
        }
    }

    /// The values at the ends of what may be drawn; all of them must be sound.
    pub fn extremes(&self) -> Vec<Node> {
        match &self.law {
            Law::Uniform(low, high) => vec![float(*low), float(*high)],
            Law::Choice(items) => items.clone(),
            Law::Normal(RawNormal { mean, sigma }) => {
                vec![float(mean - CUT_SIGMAS * sigma), float(mean + CUT_SIGMAS * sigma)]
            }
        }
    }
}

fn float(value: f64) -> Node {
    Node::bare(Value::Float(value))
}

/// Evenly in [0, 1), 53 bits.
fn unit(rng: &mut ChaCha8Rng) -> f64 {
    (rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}

/// Standard normal within ±[`CUT_SIGMAS`] (Box and Muller 1958, through `libm`: the same on every machine).
fn cut_normal(rng: &mut ChaCha8Rng) -> f64 {
    loop {
        let radius = libm::sqrt(-2.0 * libm::log(1.0 - unit(rng)));
        let value = radius * libm::cos(std::f64::consts::TAU * unit(rng));
        if value.abs() <= CUT_SIGMAS {
            return value;
        }
    }
}

/// FNV-1a, 64 bit: a number for a key that no library version changes.
fn fnv1a(key: &str) -> u64 {
    key.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn number(node: &Node) -> f64 {
        match node.value {
            Value::Float(value) => value,
            ref other => panic!("{other} is no number"),
        }
    }

    #[test]
    fn truth_fnv1a_of_the_published_vectors() {
        // Fowler, Noll, Vo: test vectors of FNV-1a 64.
        assert_eq!(fnv1a(""), 0xcbf2_9ce4_8422_2325);
        assert_eq!(fnv1a("a"), 0xaf63_dc4c_8601_ec8c);
        assert_eq!(fnv1a("foobar"), 0x8594_4171_f739_67e8);
    }

    #[test]
    fn truth_moments_of_the_laws() {
        let many = |law: Law| -> (f64, f64, f64) {
            let draw = Draw { key: "k".into(), law };
            let values: Vec<f64> = (0..20_000).map(|seed| number(&draw.value(seed))).collect();
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64;
            (mean, variance.sqrt(), values.iter().fold(0.0, |far: f64, v| far.max((v - mean).abs())))
        };
        // Standard error of a mean over 20 000 draws is σ/141; bounds are four of them.
        let (mean, sigma, far) = many(Law::Uniform(2.0, 4.0));
        assert!((mean - 3.0).abs() < 0.017 && (sigma - 2.0 / 12.0_f64.sqrt()).abs() < 0.01 && far < 1.02);
        let normal = RawNormal { mean: -1.0, sigma: 2.0 };
        let (mean, sigma, far) = many(Law::Normal(normal));
        // Normal cut at 2.5σ: variance factor 1 − 2·2.5·φ(2.5)/(2Φ(2.5) − 1) = 0.9112.
        assert!((mean + 1.0).abs() < 0.057, "{mean}");
        assert!((sigma - 2.0 * 0.9112_f64.sqrt()).abs() < 0.04, "{sigma}");
        assert!(far < 5.06 && far > 4.5, "{far}");
    }

    #[test]
    fn every_choice_is_drawn() {
        let items: Vec<Node> = (0..3).map(|i| float(f64::from(i))).collect();
        let draw = Draw { key: "k".into(), law: Law::Choice(items) };
        let mut counts = [0; 3];
        (0..3000).for_each(|seed| counts[number(&draw.value(seed)) as usize] += 1);
        assert!(counts.iter().all(|count| (850..1150).contains(count)), "{counts:?}");
    }
}

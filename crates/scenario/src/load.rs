use std::path::Path;

use sonoloop_types::{NeedleSpec, ProbeSpec};

use crate::check;
use crate::document::{Change, Document, Origin, options as yaml};
use crate::raw::RawScenario;
use crate::source::Source;
use crate::tree::{Node, Value};
use crate::{Disturbance, DisturbanceKind, LoadError, Material, PhantomSpec, Scenario, randomize};

/// What the command line adds to a scenario file.
#[derive(Debug, Clone)]
pub struct LoadOptions {
    /// Seed in place of the file's.
    pub seed: Option<u64>,
    /// Values in place of the file's, `key=value`: a dotted key, lists by index, and a value as YAML writes it.
    pub set: Vec<String>,
    /// Draw what `randomize` names. Without it the file's own values stand.
    pub resolve_randomize: bool,
}

impl Default for LoadOptions {
    fn default() -> Self {
        Self { seed: None, set: Vec::new(), resolve_randomize: true }
    }
}

/// Loads a scenario file and every file that it names, checked whole.
///
/// The file as written must be sound by itself: keys, types, ranges. Then come `set`, the seed's draws, and
/// every check across values and files. What any seed may draw is checked too, not only what this one does.
///
/// # Errors
///
/// The first problem found, naming file, line, key, value and bound.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Scenario, LoadError> {
    resolve(Source::read(path)?, options)
}

/// Loads the text of a scenario, such as [`Scenario::resolved_yaml`], as if it stood in the file at `path`;
/// paths inside are relative to that file's folder. The file itself need not exist.
///
/// # Errors
///
/// As [`load`].
pub fn load_text(path: &Path, text: &str, options: &LoadOptions) -> Result<Scenario, LoadError> {
    resolve(Source::from_text(path, text.to_owned())?, options)
}

/// A resolved scenario with one more disturbance, checked as if it had stood in the file; and what it does.
/// `entry` is an entry of `disturbances` without its `at_s`, as YAML or JSON.
///
/// # Errors
///
/// As [`load`].
pub fn add_disturbance(
    scenario: &Scenario,
    entry: &str,
    tick: u64,
) -> Result<(Scenario, DisturbanceKind), LoadError> {
    let written = Document::parse(Source::from_text(&scenario.source, scenario.resolved_yaml.clone())?)?;
    let mut node = serde_saphyr::from_str_with_options::<Node>(entry, yaml())
        .map_err(|error| LoadError::new(&scenario.source, format!("`{entry}`: {error}")))?;
    let at_s = tick as f64 / sonoloop_types::TICKS_PER_SECOND as f64;
    node.set("at_s", Node::bare(Value::Float(at_s))).map_err(|why| LoadError::new(&scenario.source, why))?;
    let mut tree = written.tree.clone();
    tree.push("disturbances", node).map_err(|why| LoadError::new(&scenario.source, why))?;
    let options = LoadOptions { resolve_randomize: false, ..LoadOptions::default() };
    let text = written.resolve(&tree, Vec::new())?.source.text;
    let changed = load_text(&scenario.source, &text, &options)?;
    // The last of those at its tick: the order of the file is kept.
    let after = changed.disturbances.partition_point(|disturbance| disturbance.tick <= tick);
    match changed.disturbances[..after].last().copied() {
        Some(Disturbance { tick: begins, kind }) if begins == tick => Ok((changed, kind)),
        _ => Err(LoadError::new(&scenario.source, format!("`{entry}` begins at no tick of its own"))),
    }
}

/// Loads a probe's file.
///
/// # Errors
///
/// As [`load`].
pub fn load_probe(path: &Path) -> Result<ProbeSpec, LoadError> {
    check::probe(&Document::read(path)?)
}

/// Loads a probe's file, with some of its values replaced: `key=value` each, as on the command line.
///
/// # Errors
///
/// As [`load`]; also for a value that the file could not have.
pub fn load_probe_with(path: &Path, set: &[String]) -> Result<ProbeSpec, LoadError> {
    let written = Document::read(path)?;
    check::probe(&written)?;
    let (tree, changes) = assigned(&written, set)?;
    check::probe(&written.resolve(&tree, changes)?)
}

/// Loads a needle's file.
///
/// # Errors
///
/// As [`load`].
pub fn load_needle(path: &Path) -> Result<NeedleSpec, LoadError> {
    check::needle(&Document::read(path)?)
}

/// Loads a phantom's file and the materials that it names.
///
/// # Errors
///
/// As [`load`].
pub fn load_phantom(path: &Path) -> Result<PhantomSpec, LoadError> {
    check::phantom(&Document::read(path)?)
}

/// Loads a file of materials, those too that no phantom names.
///
/// # Errors
///
/// As [`load`].
pub fn load_materials(path: &Path) -> Result<Vec<Material>, LoadError> {
    check::materials(&Document::read(path)?)
}

fn resolve(source: Source, options: &LoadOptions) -> Result<Scenario, LoadError> {
    let library = check::Library::default();
    let written = Document::parse(source)?;
    written.typed::<RawScenario>()?;

    let (mut tree, changes) = assigned(&written, &options.set)?;
    if let Some(seed) = options.seed {
        put(&written, &mut tree, "seed", Node::bare(Value::UInt(seed)))
            .map_err(|why| LoadError::new(&written.source.path, why))?;
    }
    let set = written.resolve(&tree, changes.clone())?;
    let raw: RawScenario = set.typed()?;
    if !options.resolve_randomize {
        return finish(&set, &library);
    }

    // Sound without the draws: what fails below is a draw's fault.
    check::build(&set, &library)?;
    let draws = randomize::draws(&set, &raw.randomize)?;
    tree.remove("randomize");
    let mut drawn = tree.clone();
    let mut drawn_changes = changes.clone();
    for (entry, draw) in draws.iter().enumerate() {
        // A value from the command line is not drawn over.
        if options.set.iter().any(|text| overlaps(text.split('=').next().unwrap_or(""), &draw.key)) {
            continue;
        }
        let put = |tree: &mut Node, node: Node| {
            put(&written, tree, &draw.key, node)
                .map_err(|why| set.fail(&format!("randomize.{entry}.key"), why))
        };
        for node in draw.extremes() {
            let mut tree = tree.clone();
            put(&mut tree, node)?;
            let mut changes = changes.clone();
            changes.push(Change { key: draw.key.clone(), origin: Origin::Drawable { entry } });
            check::build(&written.resolve(&tree, changes)?, &library)?;
        }
        put(&mut drawn, draw.value(raw.seed))?;
        let origin = Origin::Drawn { entry, seed: raw.seed };
        drawn_changes.push(Change { key: draw.key.clone(), origin });
    }
    finish(&written.resolve(&drawn, drawn_changes)?, &library)
}

fn finish(document: &Document, library: &check::Library) -> Result<Scenario, LoadError> {
    let mut scenario = check::build(document, library)?;
    let (seed, version) = (scenario.seed, env!("CARGO_PKG_VERSION"));
    let name = document.source.path.file_name().unwrap_or_default().to_string_lossy();
    let head = format!(
        "# {name} as resolved by sonoloop {version} for seed {seed}; paths are relative to that file.\n"
    );
    scenario.resolved_yaml.insert_str(0, &head);
    Ok(scenario)
}

/// The file's values with those of the command line put over them.
fn assigned(written: &Document, set: &[String]) -> Result<(Node, Vec<Change>), LoadError> {
    let mut tree = written.tree.clone();
    let mut changes = Vec::new();
    for text in set {
        let (key, node) = assignment(written, text)?;
        put(written, &mut tree, key, node)
            .map_err(|why| LoadError::new(&written.source.path, format!("--set {text}: {why}")))?;
        changes.push(Change { key: key.to_owned(), origin: Origin::Set });
    }
    Ok((tree, changes))
}

/// `key=value` of the command line.
fn assignment<'a>(written: &Document, text: &'a str) -> Result<(&'a str, Node), LoadError> {
    let fail = |why: String| LoadError::new(&written.source.path, format!("--set {text}: {why}"));
    let (key, value) = text.split_once('=').ok_or_else(|| fail("must be key=value".to_owned()))?;
    let node = if value.trim().is_empty() {
        Err("the value is empty (write null to turn something off)".to_owned())
    } else {
        serde_saphyr::from_str_with_options::<Node>(value, yaml())
            .map_err(|_| format!("`{value}` is not a YAML value"))
    };
    Ok((key, node.map_err(fail)?))
}

fn put(written: &Document, tree: &mut Node, key: &str, mut node: Node) -> Result<(), String> {
    node.span = Default::default();
    // An entry that a list does not have, or a key inside a number, is told here; a key that nothing knows when
    // the tree is read again.
    tree.set(key, node).map_err(|why| format!("{why} (key `{key}` of {})", written.source.path.display()))
}

/// True when one of two dotted keys lies in the other.
fn overlaps(a: &str, b: &str) -> bool {
    let (a, b) = (format!("{a}."), format!("{b}."));
    a.starts_with(&b) || b.starts_with(&a)
}

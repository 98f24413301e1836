//! `sonoloop render --gallery DIR`: the pictures of a one-page atlas, and the page.

mod page;
mod plan;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use indicatif::{ProgressBar, ProgressStyle};
use sonoloop_scenario::{FileKind, PhantomSpec, load_needle, load_phantom, load_probe_with};
use sonoloop_types::Image;
use sonoloop_ultrasound::Renderer;

use crate::cli::RenderArgs;
use crate::error::{AppError, Outcome};
use crate::output::{Stage, write_png};
use crate::paths::{file_is_there, no_file_in_the_way};
use crate::say::say;
use plan::{PhantomFile, Section, sections};

/// The page; written last, so that who finds it finds its pictures.
const PAGE: &str = "index.html";
/// The phantom that most pictures are made of, unless another is named.
const DEFAULT_PHANTOM: &str = "phantoms/gelatin_agar.yaml";

/// Renders every picture into a folder beside `folder` and gives all of them their names at the end.
pub fn gallery(folder: &Path, args: &RenderArgs) -> Result<Outcome, AppError> {
    no_file_in_the_way("--gallery", Some(folder))?;
    let chosen = args.phantom.clone().unwrap_or_else(|| PathBuf::from(DEFAULT_PHANTOM));
    file_is_there("PHANTOM", &chosen)?;
    file_is_there("--probe", &args.probe)?;
    file_is_there("--needle", &args.needle)?;
    let probe = load_probe_with(&args.probe, &args.set)?;
    let needle = load_needle(&args.needle)?;
    let phantoms = phantoms_beside(&chosen)?;

    let files: Vec<PhantomFile> =
        phantoms.iter().map(|(stem, (file, spec))| PhantomFile::new(stem, file, &spec.name)).collect();
    let sections = sections(&files, &stem(&chosen));
    let stage = Stage::ending_with(folder, PAGE).map_err(AppError::fault)?;
    let count = sections.iter().map(|section| section.pictures.len()).sum::<usize>();
    let style = ProgressStyle::with_template("atlas {bar:32} {pos}/{len} {msg}")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    let bar = ProgressBar::new(count as u64).with_style(style);
    let mut image = Image::black(probe.geometry.width_px, probe.geometry.height_px);
    for (stem, (_, spec)) in &phantoms {
        let tissue = sonoloop_world::tissue(spec);
        let mut renderer = Renderer::new(probe.clone(), needle.clone(), tissue, args.seed);
        for picture in sections.iter().flat_map(|s| &s.pictures).filter(|p| p.phantom == *stem) {
            bar.set_message(picture.file.clone());
            let slice = picture.view.slice(&probe);
            match picture.tune {
                None => renderer.render(&slice, &mut image),
                Some(tune) => {
                    let mut probe = probe.clone();
                    tune(&mut probe);
                    let tissue = sonoloop_world::tissue(spec);
                    Renderer::new(probe, needle.clone(), tissue, args.seed).render(&slice, &mut image);
                }
            }
            write_png(&stage.path(&picture.file), &image)
                .map_err(|e| AppError::Fault(format!("{}: {e}", folder.join(&picture.file).display())))?;
            bar.inc(1);
        }
    }
    stage.write(PAGE, page::html(&sections, args, &probe, &needle)).map_err(AppError::fault)?;
    stage.publish(&[]).map_err(AppError::fault)?;
    bar.finish_and_clear();
    say(folder.join(PAGE).display());
    Ok(Outcome::Pass)
}

fn stem(file: &Path) -> String {
    file.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

type Phantoms = BTreeMap<String, (PathBuf, PhantomSpec)>;

/// The chosen phantom, and every other one in its folder: the files that name the phantoms' schema.
fn phantoms_beside(chosen: &Path) -> Result<Phantoms, AppError> {
    let mut phantoms = Phantoms::from([(stem(chosen), (chosen.to_owned(), load_phantom(chosen)?))]);
    let folder = chosen.parent().unwrap_or(Path::new(""));
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let unreadable = |e| AppError::BadInput(format!("error: {}: {e}", folder.display()));
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let file = entry.map_err(unreadable)?.path();
        let is_yaml = file.is_file() && file.extension().is_some_and(|extension| extension == "yaml");
        if is_yaml
            && FileKind::of_file(&file) == Some(FileKind::Phantom)
            && !phantoms.contains_key(&stem(&file))
        {
            phantoms.insert(stem(&file), (file.clone(), load_phantom(&file)?));
        }
    }
    Ok(phantoms)
}

//! `index.html`: the atlas on one page that needs nothing but the pictures beside it.

use std::fmt::Write;

use sonoloop_types::{NeedleSpec, ProbeSpec};

use super::Section;
use crate::cli::RenderArgs;
use crate::output::escape_xml as escape;

const STYLE: &str = "\
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 1320px; margin: 0 auto; padding: 24px; }
h1 { margin: 0; font-size: 28px; }
h2 { font-size: 19px; margin: 28px 0 4px; border-bottom: 1px solid #ccc; }
p, figcaption { color: #555; margin: 4px 0 12px; }
div { display: grid; grid-template-columns: repeat(auto-fill, minmax(300px, 1fr)); gap: 12px; }
figure { margin: 0; }
img { width: 100%; height: auto; display: block; background: #000; }
";

/// The page.
pub fn html(sections: &[Section], args: &RenderArgs, probe: &ProbeSpec, needle: &NeedleSpec) -> String {
    let (probe_name, needle_name) = (escape(&probe.name), escape(&needle.name));
    let geometry = probe.geometry;
    let (width, height) = (geometry.width_px, geometry.height_px);
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n<title>sonoloop atlas</title>\n\
         <style>\n{STYLE}</style>\n</head>\n<body>\n<h1>What sonoloop draws</h1>\n\
         <p>Synthetic pictures, not for clinical use. Probe {probe_name}, needle {needle_name}, seed {}, {width} × \
         {height} pixels of {} mm, made by sonoloop {}.</p>\n",
        args.seed,
        geometry.spacing_m * 1e3,
        env!("CARGO_PKG_VERSION"),
    );
    for section in sections {
        let _ = write!(page, "<h2>{}</h2>\n<p>{}</p>\n<div>\n", escape(section.title), escape(section.note));
        for picture in &section.pictures {
            let (file, caption) = (escape(&picture.file), escape(&picture.caption));
            let _ = writeln!(
                page,
                "<figure><a href=\"{file}\"><img src=\"{file}\" alt=\"{caption}\" width=\"{width}\" \
                 height=\"{height}\" loading=\"lazy\"></a><figcaption>{caption}</figcaption></figure>"
            );
        }
        page.push_str("</div>\n");
    }
    page.push_str("</body>\n</html>\n");
    page
}

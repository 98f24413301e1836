use std::collections::BTreeMap;
use std::io::{BufRead, Read};

use super::orientation::Orientation;
use super::{MAX_SIDE_PX, SequenceProblem};

/// No honest header line is longer.
const MAX_LINE_BYTES: u64 = 64 * 1024;
/// No honest header is longer: 100 000 images with a dozen lines each.
const MAX_HEADER_BYTES: usize = 256 * 1024 * 1024;
/// Most images a file may announce.
const MAX_IMAGES: u32 = 1_000_000;

/// What a file says of its images one by one.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FieldValues {
    by_image: BTreeMap<usize, BTreeMap<String, String>>,
}

impl FieldValues {
    /// The text of one field of one image (counted from 0), such as `ImageStatus`.
    pub fn text(&self, image: usize, name: &str) -> Option<&str> {
        self.by_image.get(&image)?.get(name).map(String::as_str)
    }

    /// Time at which an image was taken, in seconds.
    pub fn timestamp_s(&self, image: usize) -> Option<f64> {
        self.text(image, "Timestamp")?.parse().ok().filter(|t: &f64| t.is_finite())
    }

    /// A 4 × 4 transform of one image, row by row, lengths in millimetres, such as `ProbeToBaseTransform`.
    pub fn transform(&self, image: usize, name: &str) -> Option<[f64; 16]> {
        let numbers: Result<Vec<f64>, _> =
            self.text(image, name)?.split_whitespace().map(str::parse).collect();
        numbers.ok()?.try_into().ok()
    }
}

/// How the data lie in the file.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Header {
    /// Stored columns and rows.
    pub size_px: [u32; 2],
    pub images: usize,
    pub orientation: Orientation,
    /// zlib, and how many bytes of it when the header says so.
    pub compressed: Option<Option<u64>>,
    pub fields: FieldValues,
}

impl Header {
    /// Reads up to and with the line of `ElementDataFile`; the data begin right behind it.
    pub fn read(input: &mut impl BufRead) -> Result<Self, SequenceProblem> {
        let mut keys = BTreeMap::new();
        let mut fields = FieldValues::default();
        let mut total = 0;
        for line in 1.. {
            let mut bytes = Vec::new();
            input.by_ref().take(MAX_LINE_BYTES).read_until(b'\n', &mut bytes)?;
            total += bytes.len();
            if bytes.is_empty() {
                return Err(if line == 1 { SequenceProblem::Empty } else { SequenceProblem::HeaderEnd });
            }
            let wrong =
                || if line == 1 { SequenceProblem::NotMeta } else { SequenceProblem::HeaderLine { line } };
            let text = std::str::from_utf8(&bytes).map_err(|_| wrong())?;
            let (key, value) = text.split_once('=').ok_or_else(wrong)?;
            let (key, value) = (key.trim(), value.trim());
            if line == 1 && (key != "ObjectType" || value != "Image") {
                return Err(SequenceProblem::NotMeta);
            }
            let is_name = !key.is_empty() && key.bytes().all(|b| b.is_ascii_graphic());
            if !is_name || total > MAX_HEADER_BYTES {
                return Err(SequenceProblem::HeaderLine { line });
            }
            if let Some((image, name)) = split_image_key(key) {
                fields.by_image.entry(image).or_default().insert(name.to_owned(), value.to_owned());
            } else {
                keys.insert(key.to_owned(), value.to_owned());
            }
            if key == "ElementDataFile" {
                break;
            }
        }
        Self::check(&keys, fields)
    }

    fn check(keys: &BTreeMap<String, String>, fields: FieldValues) -> Result<Self, SequenceProblem> {
        let get = |key: &'static str| keys.get(key).map(String::as_str);
        let need = |key: &'static str| get(key).ok_or(SequenceProblem::Missing(key));
        let only = |key: &'static str, value: &str, wanted: &str, bound| {
            if value.eq_ignore_ascii_case(wanted) {
                Ok(())
            } else {
                Err(SequenceProblem::value(key, value, bound))
            }
        };
        only("ElementDataFile", need("ElementDataFile")?, "LOCAL", "LOCAL (data in the same file)")?;
        only("ElementType", need("ElementType")?, "MET_UCHAR", "MET_UCHAR (8-bit grey levels)")?;
        only(
            "ElementNumberOfChannels",
            get("ElementNumberOfChannels").unwrap_or("1"),
            "1",
            "1 (grey levels)",
        )?;
        only("BinaryData", get("BinaryData").unwrap_or("True"), "True", "True")?;

        let dimensions = need("NDims")?;
        if !["2", "3", "4"].contains(&dimensions) {
            return Err(SequenceProblem::value("NDims", dimensions, "2, 3 or 4"));
        }
        let text = need("DimSize")?;
        let wrong = || SequenceProblem::value("DimSize", text, "NDims whole numbers: columns, rows, images");
        let sizes: Vec<u32> =
            text.split_whitespace().map(str::parse).collect::<Result<_, _>>().map_err(|_| wrong())?;
        let (width, height, images) = match (dimensions, &sizes[..]) {
            ("2", &[w, h]) => (w, h, 1),
            ("3", &[w, h, n]) | ("4", &[w, h, 1, n]) => (w, h, n),
            _ => return Err(wrong()),
        };
        let possible = (1..=MAX_SIDE_PX).contains(&width)
            && (1..=MAX_SIDE_PX).contains(&height)
            && (1..=MAX_IMAGES).contains(&images);
        if !possible {
            let bound = "columns and rows in [1, 8192], images in [1, 1000000]";
            return Err(SequenceProblem::value("DimSize", text, bound));
        }
        let key = "UltrasoundImageOrientation";
        let orientation =
            get(key).map_or(Ok(Orientation::DEPTH_DOWN), |value| Orientation::parse(key, value))?;
        let compressed = match get("CompressedData").unwrap_or("False") {
            no if no.eq_ignore_ascii_case("False") => None,
            yes if yes.eq_ignore_ascii_case("True") => Some(compressed_bytes(get("CompressedDataSize"))?),
            other => return Err(SequenceProblem::value("CompressedData", other, "True or False")),
        };
        Ok(Self { size_px: [width, height], images: images as usize, orientation, compressed, fields })
    }

    /// Bytes of one stored image.
    pub fn image_bytes(&self) -> usize {
        self.size_px[0] as usize * self.size_px[1] as usize
    }
}

fn compressed_bytes(value: Option<&str>) -> Result<Option<u64>, SequenceProblem> {
    let parse = |text: &str| {
        let wrong = SequenceProblem::value("CompressedDataSize", text, "a positive number of bytes");
        text.parse().ok().filter(|bytes| *bytes > 0).ok_or(wrong)
    };
    value.map(parse).transpose()
}

/// `Seq_Frame0012_Timestamp` → (12, "Timestamp").
fn split_image_key(key: &str) -> Option<(usize, &str)> {
    let (number, name) = key.strip_prefix("Seq_Frame")?.split_once('_')?;
    Some((number.parse().ok()?, name))
}

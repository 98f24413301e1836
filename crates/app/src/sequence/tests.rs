use std::fs;
use std::io::Write;
use std::path::Path;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use sonoloop_types::{Image, Pose};

use super::{Sequence, SequenceError, SequenceWriter};

const HEADER: &str = "ObjectType = Image\nNDims = 3\nDimSize = 3 2 2\nElementType = MET_UCHAR\n";
const PIXELS: [u8; 12] = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12];

fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn file(folder: &Path, lines: &str, body: &[u8]) -> std::path::PathBuf {
    let path = folder.join("a.mha");
    fs::write(&path, [lines.as_bytes(), b"ElementDataFile = LOCAL\n", body].concat()).unwrap();
    path
}

fn read_all(path: &Path) -> Result<Vec<Image>, SequenceError> {
    let mut sequence = Sequence::open(path)?;
    let mut images = Vec::new();
    while let Some(image) = sequence.next_image()? {
        images.push(image);
    }
    assert_eq!(images.len(), sequence.image_count());
    Ok(images)
}

fn message(path: &Path) -> String {
    let message = read_all(path).expect_err("a bad file").to_string();
    assert!(!message.contains('\n'), "{message:?}");
    assert!(message.starts_with(&path.display().to_string()), "{message}");
    message
}

#[test]
fn raw_and_compressed_data_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let packed = zlib(&PIXELS);
    let sized = format!("{HEADER}CompressedData = True\nCompressedDataSize = {}\n", packed.len());
    let unsized_ = format!("{HEADER}CompressedData = True\n");
    let turned = format!("{HEADER}UltrasoundImageOrientation = MNA\n");
    for (lines, body, first) in [
        (HEADER, &PIXELS[..], [1, 2, 3, 4, 5, 6]),
        (&sized, &packed, [1, 2, 3, 4, 5, 6]),
        (&unsized_, &packed, [1, 2, 3, 4, 5, 6]),
        (&turned, &PIXELS, [4, 5, 6, 1, 2, 3]),
    ] {
        let images = read_all(&file(folder.path(), lines, body)).unwrap();
        assert_eq!(images.len(), 2);
        assert_eq!((images[0].width_px, images[0].height_px), (3, 2));
        assert_eq!(images[0].pixels, first);
    }
}

#[test]
fn bad_headers_name_key_and_value() {
    let folder = tempfile::tempdir().unwrap();
    let broken = |from: &str, to: &str| {
        let path = file(folder.path(), &HEADER.replace(from, to), &PIXELS);
        message(&path)
    };
    for (from, to, expected) in [
        ("MET_UCHAR", "MET_FLOAT", "ElementType = MET_FLOAT must be MET_UCHAR"),
        ("3 2 2", "3 2", "DimSize = 3 2 must be NDims whole numbers"),
        ("3 2 2", "3 -2 2", "DimSize = 3 -2 2 must be"),
        ("3 2 2", "3 0 2", "DimSize = 3 0 2 must be"),
        ("3 2 2", "99999 99999 99999", "DimSize = 99999 99999 99999 must be"),
        ("NDims = 3", "NDims = 7", "NDims = 7 must be"),
        ("DimSize = 3 2 2\n", "", "DimSize is missing"),
        ("NDims = 3", "CompressedData = maybe\nNDims = 3", "CompressedData = maybe must be True or False"),
        (
            "NDims = 3",
            "UltrasoundImageOrientation = XX\nNDims = 3",
            "UltrasoundImageOrientation = XX must be",
        ),
        ("NDims = 3", "no equals sign\nNDims = 3", "header line 2 is not"),
        ("ObjectType = Image", "ObjectType = Mesh", "not an .mha sequence"),
    ] {
        let message = broken(from, to);
        assert!(message.contains(expected), "{message}\nexpected {expected}");
    }
}

#[test]
fn damaged_files_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("b.mha");
    let refused = |content: &[u8], expected: &str| {
        fs::write(&path, content).unwrap();
        let message = message(&path);
        assert!(message.contains(expected), "{message}\nexpected {expected}");
    };
    refused(b"", "the file is empty");
    refused(&[0, 159, 146, 150, 255, 10, 0, 1], "not an .mha sequence");
    refused(&[b'x'; 300_000], "not an .mha sequence");
    refused(HEADER.as_bytes(), "the header has no ElementDataFile");
    assert!(message(&file(folder.path(), HEADER, &PIXELS[..11])).contains("the data end in image 1 of 2"));
    let long = [&PIXELS[..], &[13]].concat();
    assert!(message(&file(folder.path(), HEADER, &long)).contains("more data follow than 2 images"));

    let packed = zlib(&PIXELS);
    let compressed = format!("{HEADER}CompressedData = True\n");
    let sized = format!("{compressed}CompressedDataSize = {}\n", packed.len());
    let cut = &packed[..packed.len() - 6];
    assert!(message(&file(folder.path(), &sized, cut)).contains("CompressedDataSize = "));
    assert!(message(&file(folder.path(), &compressed, cut)).contains("the data end in image"));
    assert!(
        message(&file(folder.path(), &compressed, &zlib(&PIXELS[..9]))).contains("the data end in image 1")
    );
    assert!(message(&file(folder.path(), &compressed, &zlib(&long))).contains("more data follow"));
    assert!(message(&file(folder.path(), &compressed, &[7; 40])).contains("damaged in image 0"));
    assert!(message(&folder.path().join("missing.mha")).contains("No such file"));
}

#[test]
fn what_is_written_is_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sequence.mha");
    let image = |k: u8| Image::from_pixels(4, 3, (0..12).map(|p| p * 7 + k).collect()).unwrap();
    let pose = Pose::from_parts(
        [0.1, -0.02, 0.3].into(),
        nalgebra::UnitQuaternion::from_euler_angles(0.1, 0.2, 0.3),
    );
    let mut writer = SequenceWriter::create(&path, [4, 3], 0.1).unwrap();
    writer.set("Scenario", "lateral plain").unwrap();
    for k in 0..3 {
        let time_s = 0.04 * f64::from(k);
        writer.push(&image(k), time_s, &[("ProbeToBase", pose)], &[("TipPx", "1.5 2.25")]).unwrap();
    }
    assert!(writer.push(&Image::black(3, 4), 0.0, &[], &[]).is_err());
    assert!(writer.push(&image(0), 0.0, &[], &[("two words", "x")]).is_err());
    assert!(writer.push(&image(0), 0.0, &[], &[("Name", "two\nlines")]).is_err());
    assert!(!path.exists());
    writer.finish().unwrap();
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file is left");

    let sequence = Sequence::open(&path).unwrap();
    let fields = sequence.fields().unwrap();
    assert_eq!(fields.timestamp_s(2), Some(0.08));
    assert_eq!(fields.text(1, "TipPx"), Some("1.5 2.25"));
    assert_eq!(fields.text(3, "TipPx"), None);
    let read = fields.transform(1, "ProbeToBaseTransform").unwrap();
    let expected = pose.to_homogeneous();
    for row in 0..4 {
        for column in 0..4 {
            let unit = if column == 3 && row < 3 { 1000.0 } else { 1.0 };
            assert!((read[4 * row + column] - unit * expected[(row, column)]).abs() < 1e-9);
        }
    }
    let images = read_all(&path).unwrap();
    assert_eq!(images, [0, 1, 2].map(image));
}

#[test]
fn a_folder_of_png_files_is_read_in_order() {
    let folder = tempfile::tempdir().unwrap();
    assert!(message(folder.path()).contains("no .png files"));
    for k in [10_u8, 9, 1] {
        let picture = image::GrayImage::from_pixel(5, 4, image::Luma([k]));
        picture.save(folder.path().join(format!("image{k}.png"))).unwrap();
    }
    fs::write(folder.path().join("notes.txt"), "not a picture").unwrap();
    let levels: Vec<u8> = read_all(folder.path()).unwrap().iter().map(|image| image.pixels[0]).collect();
    assert_eq!(levels, [1, 9, 10]);

    image::GrayImage::new(6, 4).save(folder.path().join("image99.png")).unwrap();
    let error = read_all(folder.path()).unwrap_err().to_string();
    assert!(error.contains("image99.png: 6 × 4 px, but the first image has 5 × 4 px"), "{error}");
    fs::write(folder.path().join("image2.png"), "junk").unwrap();
    assert!(read_all(folder.path()).unwrap_err().to_string().contains("image2.png"));
}

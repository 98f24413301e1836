use sonoloop_types::Image;

use super::SequenceProblem;

/// How stored rows and columns lie in the body, from the letters of `UltrasoundImageOrientation`: the first for
/// the columns, the second for the rows; M and U point to the marked and unmarked side of the probe, F and N away
/// from and towards the transducer. A third letter (between images) means nothing here.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Orientation {
    /// Depth runs along the stored columns.
    transposed: bool,
    /// Depth runs backwards.
    towards_transducer: bool,
}

impl Orientation {
    /// Rows run away from the transducer, as in the picture on a scanner.
    pub const DEPTH_DOWN: Self = Self { transposed: false, towards_transducer: false };

    pub fn parse(key: &str, value: &str) -> Result<Self, SequenceProblem> {
        let letters: Vec<char> = value.chars().collect();
        let lateral = |c: char| c == 'M' || c == 'U';
        let depth = |c: char| c == 'F' || c == 'N';
        match letters[..] {
            [a, b] | [a, b, 'A' | 'D'] if lateral(a) && depth(b) => {
                Ok(Self { transposed: false, towards_transducer: b == 'N' })
            }
            [a, b] | [a, b, 'A' | 'D'] if depth(a) && lateral(b) => {
                Ok(Self { transposed: true, towards_transducer: a == 'N' })
            }
            _ => {
                Err(SequenceProblem::value(key, value, "one of MF, MN, UF, UN, FM, FU, NM, NU (and A or D)"))
            }
        }
    }

    /// Turns a stored image of `[columns, rows]` so that depth runs down. The lateral order stays as stored.
    pub fn turn(self, size_px: [u32; 2], stored: Vec<u8>) -> Image {
        let [width, height] = size_px.map(|n| n as usize);
        if self == Self::DEPTH_DOWN {
            return Image { width_px: size_px[0], height_px: size_px[1], pixels: stored };
        }
        let (columns, rows) = if self.transposed { (height, width) } else { (width, height) };
        let mut pixels = Vec::with_capacity(stored.len());
        for v in 0..rows {
            let depth = if self.towards_transducer { rows - 1 - v } else { v };
            if self.transposed {
                pixels.extend((0..columns).map(|u| stored[u * width + depth]));
            } else {
                pixels.extend_from_slice(&stored[depth * width..][..width]);
            }
        }
        Image { width_px: columns as u32, height_px: rows as u32, pixels }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turned(letters: &str) -> Image {
        // Stored: 1 2 3 / 4 5 6.
        Orientation::parse("UltrasoundImageOrientation", letters)
            .unwrap()
            .turn([3, 2], vec![1, 2, 3, 4, 5, 6])
    }

    #[test]
    fn depth_runs_down_from_every_orientation() {
        for letters in ["MF", "UF", "MFA", "UFD"] {
            assert_eq!(turned(letters).pixels, [1, 2, 3, 4, 5, 6]);
        }
        for letters in ["MN", "UN", "MNA"] {
            assert_eq!(turned(letters).pixels, [4, 5, 6, 1, 2, 3]);
        }
        let far = turned("FM");
        assert_eq!((far.width_px, far.height_px), (2, 3));
        assert_eq!(far.pixels, [1, 4, 2, 5, 3, 6]);
        assert_eq!(turned("NU").pixels, [3, 6, 2, 5, 1, 4]);
    }

    /// A body with a mark at depth 0 on the left (9), and another at the greatest depth beside it (5), stored in each of the eight
    /// ways: column, then row direction. Lateral order stays as stored, so only depth is turned.
    #[test]
    fn truth_all_eight_orientations_of_one_body() {
        let body = [9, 1, 2, 0, 3, 4, 0, 5, 6, 0, 7, 8];
        let upright: [u8; 12] = body; // 3 columns × 4 rows of depth
        let from_below: [u8; 12] = [0, 7, 8, 0, 5, 6, 0, 3, 4, 9, 1, 2];
        let lying: [u8; 12] = [9, 0, 0, 0, 1, 3, 5, 7, 2, 4, 6, 8]; // 4 columns of depth × 3 rows
        let lying_from_below: [u8; 12] = [0, 0, 0, 9, 7, 5, 3, 1, 8, 6, 4, 2];
        for (letters, size_px, stored) in [
            ("MF", [3, 4], upright),
            ("UF", [3, 4], upright),
            ("MN", [3, 4], from_below),
            ("UN", [3, 4], from_below),
            ("FM", [4, 3], lying),
            ("FU", [4, 3], lying),
            ("NM", [4, 3], lying_from_below),
            ("NU", [4, 3], lying_from_below),
        ] {
            for third in ["", "A", "D"] {
                let letters = format!("{letters}{third}");
                let orientation = Orientation::parse("UltrasoundImageOrientation", &letters).unwrap();
                let image = orientation.turn(size_px, stored.to_vec());
                assert_eq!((image.width_px, image.height_px), (3, 4), "{letters}");
                assert_eq!(image.pixels, body, "{letters}");
            }
        }
    }

    #[test]
    fn other_letters_are_refused() {
        for letters in ["", "M", "MM", "FN", "XX", "MFQ", "mf", "MFAA"] {
            let error = Orientation::parse("UltrasoundImageOrientation", letters).unwrap_err().to_string();
            assert!(
                error.starts_with(&format!("UltrasoundImageOrientation = {letters} must be one of")),
                "{error}"
            );
        }
    }
}

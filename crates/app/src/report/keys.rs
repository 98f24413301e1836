use sonoloop_types::TrackState;

use super::ImageLine;

/// A picture worth showing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct KeyImage {
    pub label: &'static str,
    pub index: usize,
}

/// Up to six images that tell the run: start, last before the loss, loss, in the search, recovered, end. A
/// run without a loss is told in quarters.
pub(super) fn key_images(rows: &[ImageLine]) -> Vec<KeyImage> {
    let Some(last) = rows.len().checked_sub(1) else { return Vec::new() };
    let mut keys = vec![KeyImage { label: "start", index: 0 }];
    let is_lost = |row: &ImageLine| row.state == Some(TrackState::Lost);
    let lost = rows.windows(2).position(|pair| pair[0].is_tracking() && is_lost(&pair[1]));
    if let Some(before_declared) = lost {
        let declared = before_declared + 1;
        // The true loss is what is worth comparing with, when there was one shortly before.
        let before = rows[..=before_declared].iter().rposition(|row| row.visible == 1);
        keys.push(KeyImage { label: "before the loss", index: before.unwrap_or(before_declared) });
        keys.push(KeyImage { label: "loss declared", index: declared });
        let recovered = rows[declared..].iter().position(ImageLine::is_tracking).map(|k| declared + k);
        keys.push(KeyImage { label: "searching", index: (declared + recovered.unwrap_or(last)) / 2 });
        keys.extend(recovered.map(|index| KeyImage { label: "recovered", index }));
    } else {
        let parts = [("a quarter", 1), ("half way", 2), ("three quarters", 3)];
        keys.extend(parts.map(|(label, quarters)| KeyImage { label, index: last * quarters / 4 }));
    }
    keys.push(KeyImage { label: "end", index: last });
    keys.dedup_by_key(|key| key.index);
    keys
}

#[cfg(test)]
mod tests {
    use sonoloop_types::ImageGeometry;

    use super::*;
    use crate::judge::test_recording::scripted;
    use crate::output::images_csv;
    use crate::output::test_run::scenario;
    use crate::report::parse_csv;

    fn keys(visibility: &str, states: &str) -> Vec<(&'static str, usize)> {
        let probe = scenario(ImageGeometry::default()).probe;
        let images: Vec<ImageLine> =
            parse_csv(&images_csv(&scripted(visibility, states).images, &probe)).unwrap();
        key_images(&images).iter().map(|key| (key.label, key.index)).collect()
    }

    #[test]
    fn a_recovery_is_told_in_six_pictures() {
        assert_eq!(
            keys("vvv-----vvvv", "TTTTTLLLRRTT"),
            [
                ("start", 0),
                ("before the loss", 2),
                ("loss declared", 5),
                ("searching", 7),
                ("recovered", 10),
                ("end", 11)
            ]
        );
    }

    #[test]
    fn a_plain_run_is_told_in_quarters() {
        let told = keys("vvvvvvvvv", "TTTTTTTTT");
        assert_eq!(told.iter().map(|key| key.1).collect::<Vec<_>>(), [0, 2, 4, 6, 8]);
        assert_eq!(keys("", ""), []);
        assert_eq!(keys("v", "T"), [("start", 0)]);
    }
}

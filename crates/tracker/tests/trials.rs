//! Trials of the robust profile: a needle over speckle that stands still, twenty seeds times three angles for each
//! combination of background, speed, similarity and template. No seed here took part in choosing a setting.
//!
//! The sequences are those of the full table (`cargo run --release -p sonoloop-tracker --example breaking`), cut to the
//! first 264 px of the needle's way: 120 images at 2.2 px, 66 at 4 px.

mod support;

use std::sync::{Arc, LazyLock};

use sonoloop_types::{Profile, Similarity, TrackerSettings};
use support::{Fade, Faded, NeedleScene, Outcome, Shares, Tissue, fade, follow, in_parallel, steady};

const ANGLES_RAD: [f64; 3] = [0.2, 0.45, -0.5];
const BACKGROUNDS: [f32; 5] = [0.1, 0.3, 0.5, 0.8, 1.0];
const SPEEDS_PX: [f64; 2] = [2.2, 4.0];
const WAY_PX: f64 = 264.0;

/// Seeds and their tissue, which all trials share.
static TISSUES: LazyLock<Vec<(u64, Arc<Tissue>)>> = LazyLock::new(|| {
    let seeds: Vec<u64> = (5000..5020).collect();
    in_parallel(&seeds, |seed| (*seed, Arc::new(Tissue::new(*seed))))
});

fn with(profile: Profile, similarity: Similarity, template_px: u32) -> TrackerSettings {
    TrackerSettings { similarity, ..TrackerSettings::profile(profile, template_px) }
}

/// Outcomes of one seed and background: for every speed and angle, those of all `settings` over the same images.
fn outcomes(
    tissue: &Arc<Tissue>,
    seed: u64,
    background: f32,
    settings: &[TrackerSettings],
) -> Vec<Vec<Outcome>> {
    let mut all = Vec::new();
    for speed_px in SPEEDS_PX {
        for angle_rad in ANGLES_RAD {
            let mut scene = NeedleScene::over(tissue, seed, background, angle_rad);
            scene.speed_px = speed_px;
            all.push(follow(&mut scene, settings, (WAY_PX / speed_px) as u32, [0.0; 2], steady));
        }
    }
    all
}

#[test]
fn robust_follows_the_needle_over_every_background_and_is_never_silently_lost() {
    let settings = [
        with(Profile::Robust, Similarity::Ssd, 20),
        with(Profile::Robust, Similarity::Scv, 20),
        with(Profile::Robust, Similarity::Ssd, 31),
        with(Profile::Robust, Similarity::Scv, 31),
    ];
    let results = in_parallel(&TISSUES, |(seed, tissue)| {
        BACKGROUNDS.map(|background| outcomes(tissue, *seed, background, &settings))
    });
    let angles = ANGLES_RAD.len();
    for (b, background) in BACKGROUNDS.iter().enumerate() {
        for (s, speed_px) in SPEEDS_PX.iter().enumerate() {
            for (which, settings) in settings.iter().enumerate() {
                let sequences = results.iter().flat_map(|seed| &seed[b][s * angles..][..angles]);
                let shares = Shares::of(sequences.map(|outcomes| outcomes[which]));
                let fine = shares.percent(Outcome::Tracked) >= 95.0 && shares.percent(Outcome::Silent) == 0.0;
                let TrackerSettings { similarity, template_px, .. } = settings;
                assert!(fine, "{background}, {speed_px} px, {similarity:?} {template_px}: {shares}");
            }
        }
    }
}

/// What the robust profile is for; and that these trials can be failed.
#[test]
fn the_paper_profile_loses_the_needle_silently_over_a_bright_background() {
    let settings = [Similarity::Ssd, Similarity::Scv].map(|s| with(Profile::Paper, s, 20));
    let results = in_parallel(&TISSUES[..6], |(seed, tissue)| outcomes(tissue, *seed, 0.8, &settings));
    for which in 0..settings.len() {
        let shares = Shares::of(results.iter().flatten().map(|outcomes| outcomes[which]));
        assert!(shares.percent(Outcome::Silent) > 50.0, "{:?}: {shares}", settings[which].similarity);
    }
}

/// As in the full table, with less of the needle's way before it fades: 30 images instead of 90. It is as long away.
#[test]
fn a_needle_that_fades_is_declared_lost_and_found_again() {
    let mut cases = Vec::new();
    for background in [0.1, 0.5, 1.0] {
        for similarity in [Similarity::Ssd, Similarity::Scv] {
            cases.push((background, similarity));
        }
    }
    let results = in_parallel(&TISSUES, |(seed, tissue)| {
        let over = if seed % 2 == 0 { 1 } else { 8 };
        let course = Fade { gone: 30, back: 60, images: 75, over };
        let one = |&(background, similarity): &(f32, Similarity)| {
            ANGLES_RAD.map(|angle_rad| {
                let mut scene = NeedleScene::over(tissue, *seed, background, angle_rad);
                fade(&mut scene, with(Profile::Robust, similarity, 20), course)
            })
        };
        cases.iter().map(one).collect::<Vec<_>>()
    });
    for (which, case) in cases.iter().enumerate() {
        let all: Vec<Faded> = results.iter().flat_map(|seed| seed[which]).collect();
        let share = |is: fn(&Faded) -> bool| all.iter().filter(|f| is(f)).count() as f64 / all.len() as f64;
        let shares =
            [share(|f| f.kept), share(|f| f.declared), share(|f| f.stayed_lost), share(|f| f.recovered)];
        assert!(shares.iter().all(|share| *share >= 0.98), "{case:?}: {shares:?}");
    }
}

/// The scenes keep what did not change from the last image; nobody may see that.
#[test]
fn an_image_drawn_after_others_is_the_one_drawn_at_once() {
    let tissue = Arc::new(Tissue::moving(5100));
    for angle_rad in ANGLES_RAD {
        // The other scene had no needle before, and its tissue was elsewhere.
        let [mut drawn, mut afresh] = [0, 1].map(|_| NeedleScene::over(&tissue, 5100, 0.3, angle_rad));
        for scene in [&mut drawn, &mut afresh] {
            scene.decoy_tip_px = Some([260.0, 210.0]);
        }
        for k in 0..40 {
            let tip = steady(&mut drawn, k);
            drawn.image(tip, 1.0);
            afresh.tissue_quarters = 7 * k as i32;
            afresh.image(tip, 0.0);
        }
        let tip = steady(&mut drawn, 40);
        afresh.tissue_quarters = 0;
        let pixels = [drawn, afresh].map(|mut scene| scene.image(tip, 1.0).pixels);
        // A shaft far behind the tip is drawn without the end it has there, 10⁻⁷ of its amplitude.
        let differ = pixels[0].iter().zip(&pixels[1]).filter(|(a, b)| a != b);
        assert!(differ.clone().all(|(a, b)| a.abs_diff(*b) == 1) && differ.count() < 10);
    }
}

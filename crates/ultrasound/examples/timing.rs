#[path = "../tests/common/mod.rs"]
mod common;
use common::*;
use sonoloop_types::Image;
use sonoloop_ultrasound::Renderer;
use std::time::Instant;
fn cpu_ms() -> f64 {
    std::fs::read_to_string("/proc/thread-self/schedstat")
        .unwrap()
        .split(' ')
        .next()
        .unwrap()
        .parse::<f64>()
        .unwrap()
        * 1e-6
}
fn main() {
    let threads: usize = std::env::args().nth(1).map_or(2, |a| a.parse().unwrap());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let t = Instant::now();
        let mut r = Renderer::new(
            probe(),
            needle(),
            sonoloop_types::Tissue::homogeneous([0.2, 0.1, 0.06], material(Some(0.0), 0.5)),
            1,
        );
        println!("new {:.1} ms", t.elapsed().as_secs_f64() * 1e3);
        let mut image = Image::black(640, 480);
        let t = Instant::now();
        r.render(&slice(pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)), &mut image);
        println!("first {:.1} ms", t.elapsed().as_secs_f64() * 1e3);
        let only: Option<usize> = std::env::args().nth(2).map(|a| a.parse().unwrap());
        for (index, (yaw, roll, pitch, with)) in [
            (0.0, 0.0, 0.0, false),
            (0.0, 0.0, 0.0, true),
            (20.0, 2.0, 1.0, true),
            (0.0, 15.0, 0.0, false),
            (45.0, 30.0, 30.0, false),
            (0.0, -30.0, -30.0, false),
        ]
        .into_iter()
        .enumerate()
        {
            if only.is_some_and(|o| o != index) {
                continue;
            }
            let mut times = Vec::new();
            for i in 0..200 {
                let p = pose(0.01 * i as f64, 0.02 * i as f64, 0.0, yaw, roll + 0.02 * i as f64, pitch);
                let mut s = slice(p);
                s.sequence = i;
                if with {
                    s.needle = Some(needle_in_probe(&p, [5.0, 0.1, 25.0], [0.766, 0.0, 0.643], 38.0));
                }
                let t = Instant::now();
                let c = cpu_ms();
                r.render(&s, &mut image);
                let _ = c;
                times.push(t.elapsed().as_secs_f64() * 1e3);
            }
            times.sort_by(f64::total_cmp);
            println!(
                "yaw {yaw} roll {roll} pitch {pitch} needle {with}: min {:.2} p10 {:.2} median {:.2}",
                times[0], times[20], times[100]
            );
        }
    });
}

#!/usr/bin/env python3
"""`sonoloop track` beside OpenCV, in one run on one thread.

    pip install numpy opencv-python-headless
    cargo build --release
    benches/peers/track.py target/release/sonoloop [--template 20] [--seeds 7 1 2 3 4]

A bright tip over log-compressed speckle, all of it moving together by up to 3 px per axis and image, 8 % of fresh speckle
in every image. Prints, per method, the median time per image, and the median error and the images not tracked per seed.
OpenCV's ECC registers the first patch in a region of interest of ±24 px, with a blur of 5 px; its template match searches
the whole image.
"""
import argparse
import csv
import pathlib
import subprocess
import tempfile
import time

import cv2
import numpy as np

WIDTH, HEIGHT, MARGIN, ROI = 640, 480, 64, 24


def speckle(rng, height, width):
    """Envelope of a complex Gaussian field with grains of 2 px by 1 px, unit rms."""
    parts = [cv2.GaussianBlur(rng.standard_normal((height, width)), (0, 0), sigmaX=2.0, sigmaY=1.0) for _ in range(2)]
    envelope = np.hypot(*parts)
    return envelope / np.sqrt((envelope**2).mean())


def tip_echo(height, width, u0, v0, angle=0.45, amplitude=6.0):
    v, u = np.mgrid[0:height, 0:width].astype(float)
    along = (u - u0) * np.cos(angle) + (v - v0) * np.sin(angle)
    across = (v - v0) * np.cos(angle) - (u - u0) * np.sin(angle)
    shaft = 0.55 * np.exp(-(across**2) / (2 * 1.6**2)) / (1 + np.exp(along / 1.2))
    return amplitude * (shaft + np.exp(-((along + 2) ** 2 / (2 * 3.0**2) + across**2 / (2 * 2.2**2))))


def scene(images, seed):
    """Images and true tips; 50 dB on 255 grey levels."""
    rng = np.random.default_rng(seed)
    size = (HEIGHT + 2 * MARGIN, WIDTH + 2 * MARGIN)
    field = speckle(rng, *size) + tip_echo(*size, WIDTH / 2 + MARGIN, HEIGHT / 2 + MARGIN)
    stack, tips, shift = [], [], np.zeros(2)
    for k in range(images):
        step = rng.uniform(-3, 3, 2) if k else np.zeros(2)
        shift = np.clip(shift + step, -40, 40)
        moved = cv2.warpAffine(field, np.float32([[1, 0, shift[0] - MARGIN], [0, 1, shift[1] - MARGIN]]), (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC)
        level_db = 20 * np.log10(np.maximum(moved * (1 + 0.08 * (speckle(rng, HEIGHT, WIDTH) - 1)), 1e-6) / 8)
        stack.append((np.clip(level_db / 50 + 1, 0, 1) * 255).astype(np.uint8))
        tips.append(np.array([WIDTH / 2, HEIGHT / 2]) + shift)
    return stack, np.stack(tips)


def patch(stack, tips, side):
    corner = np.round(tips[0]).astype(int) - side // 2
    return stack[0][corner[1] : corner[1] + side, corner[0] : corner[0] + side].copy(), corner


def ecc(stack, tips, side, motion):
    template, corner = patch(stack, tips, side)
    warp = np.float32([[1, 0, corner[0]], [0, 1, corner[1]]])
    for image in stack[1:]:
        start = time.perf_counter()
        x, y = (int(np.clip(int(warp[k, 2]) - ROI, 0, limit - side - 2 * ROI)) for k, limit in ((0, WIDTH), (1, HEIGHT)))
        local = warp - np.float32([[0, 0, x], [0, 0, y]])
        try:
            region = image[y : y + side + 2 * ROI, x : x + side + 2 * ROI]
            _, local = cv2.findTransformECC(template, region, local, motion, (3, 50, 1e-4), None, 5)
            warp = local + np.float32([[0, 0, x], [0, 0, y]])
        except cv2.error:
            pass
        yield (time.perf_counter() - start) * 1e6, warp[:, :2] @ (tips[0] - corner) + warp[:, 2]


def match(stack, tips, side):
    template, corner = patch(stack, tips, side)
    for image in stack[1:]:
        start = time.perf_counter()
        place = cv2.minMaxLoc(cv2.matchTemplate(image, template, cv2.TM_CCOEFF_NORMED))[3]
        yield (time.perf_counter() - start) * 1e6, np.array(place) + tips[0] - corner


def sonoloop(binary, folder, tips, side, options):
    click = f"{tips[0][0]:.4f},{tips[0][1]:.4f}"
    command = [binary, "track", folder / "in", "--init", click, "--template", str(side), "--out", folder / "out", *options]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    for row in list(csv.DictReader(open(folder / "out" / "track.csv")))[1:]:
        tracking = row["state"] == "tracking"
        yield float(row["time_us"]), np.array([float(row["u_px"]), float(row["v_px"])]) if tracking else None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("binary", type=pathlib.Path)
    parser.add_argument("--template", type=int, default=20)
    parser.add_argument("--images", type=int, default=120)
    parser.add_argument("--seeds", type=int, nargs="+", default=[7, 1, 2, 3, 4])
    args = parser.parse_args()
    cv2.setNumThreads(1)
    times, errors = {}, {}
    for seed in args.seeds:
        stack, tips = scene(args.images, seed)
        with tempfile.TemporaryDirectory() as work:
            work = pathlib.Path(work)
            (work / "in").mkdir()
            for k, image in enumerate(stack):
                cv2.imwrite(str(work / "in" / f"{k:04d}.png"), image)
            methods = {
                f"sonoloop {similarity} {warp}": sonoloop(
                    args.binary.resolve(), work, tips, args.template, ["--similarity", similarity, "--warp", warp])
                for similarity in ("ssd", "scv") for warp in ("translation", "affine")
            }
            methods["OpenCV ECC translation"] = ecc(stack, tips, args.template, cv2.MOTION_TRANSLATION)
            methods["OpenCV ECC affine"] = ecc(stack, tips, args.template, cv2.MOTION_AFFINE)
            methods["OpenCV matchTemplate"] = match(stack, tips, args.template)
            for name, answers in methods.items():
                answers = list(answers)
                off = [np.inf if at is None else np.hypot(*(at - tip)) for (_, at), tip in zip(answers, tips[1:])]
                times.setdefault(name, []).extend(us for us, _ in answers)
                errors.setdefault(name, []).append((np.median(off), int(np.isinf(off).sum())))
    for name in times:
        per_seed = "  ".join(f"{px:.3f}/{lost}" for px, lost in errors[name])
        print(f"{name:28s} {np.median(times[name]):8.1f} µs   {per_seed} px/images not tracked")


if __name__ == "__main__":
    main()

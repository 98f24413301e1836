// The 3-D scene: robots from their URDF, phantom with inclusions, needle, probe, the image plane in place. Metres, z up.

import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import URDFLoader from "urdf-loader";
import { colour } from "./colours.js";

/** Drawn at most so often: the machine is the simulator's first. */
const EVERY_MS = 40;
/** Nothing nearer to the camera is drawn. */
const NEAR_M = 5e-3;
const NEEDLE_RADIUS_M = 6e-4;
/** Housing of the probe: across its array, across the plane, along its axis. */
const HOUSING_M = [8e-3, 20e-3, 70e-3];
const VIEWS = {
  orbit: { from: [0.5, -1.15, 0.65], at: [-0.05, 0, 0.1] },
  near: { from: [0.12, -0.22, 0.12], at: [0, 0, -0.015] },
  // Without what stands above the phantom: the arm would hide it.
  top: { from: [0, -0.001, 0.42], at: [0, 0, -0.02], near: 0.34 },
  side: { from: [0, -0.32, 0.0], at: [0, 0, 0.0] },
};

const place = (object, [x, y, z, qx, qy, qz, qw]) => {
  object.position.set(x, y, z);
  object.quaternion.set(qx, qy, qz, qw);
};

export class Scene {
  constructor(canvas, image) {
    this.canvas = canvas;
    this.image = image;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.scene = new THREE.Scene();
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x8090a0, 2.2));
    const sun = new THREE.DirectionalLight(0xffffff, 1.6);
    sun.position.set(0.6, -1, 2);
    this.scene.add(sun);
    this.camera = new THREE.PerspectiveCamera(40, 1, NEAR_M, 10);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => this.later());
    this.controls.addEventListener("start", () => this.near(NEAR_M));
    this.view("near");
    new ResizeObserver(() => this.size()).observe(canvas.parentElement);
  }

  begin(about) {
    this.everything?.removeFromParent();
    this.everything?.traverse((object) => object.geometry?.dispose());
    this.texture?.dispose();
    this.everything = new THREE.Group();
    this.scene.add(this.everything);
    this.about = about;
    // Nothing is anywhere before the first image.
    this.state = null;
    this.everything.visible = false;
    this.arm = this.robot(about.arm, 0xd8822e);
    this.needleRobot = about.needle_robot && this.robot(about.needle_robot, 0x6f8596);
    this.phantom = this.makePhantom(about.phantom);
    this.probe = this.makeProbe(about.setting);
    this.needle = new THREE.Mesh(new THREE.BufferGeometry(), new THREE.MeshStandardMaterial({ color: 0x9aa7b3, metalness: 0.6, roughness: 0.35 }));
    // What joins flange and housing; its shape is not told.
    this.holder = new THREE.Mesh(new THREE.CylinderGeometry(0.012, 0.012, 1, 16).rotateX(Math.PI / 2), new THREE.MeshStandardMaterial({ color: 0x50575e }));
    this.everything.add(this.phantom, this.probe, this.needle, this.holder);
    this.later();
  }

  /** A robot by its collision shapes where it has no others; meshes are not fetched. */
  robot(spec, tint) {
    const loader = new URDFLoader();
    loader.parseCollision = true;
    loader.loadMeshCb = (path, manager, done) => done(new THREE.Group());
    const robot = loader.parse(spec.urdf);
    const material = new THREE.MeshStandardMaterial({ color: tint, roughness: 0.6 });
    robot.traverse((object) => {
      object.visible = true;
      if (object.isMesh) object.material = material;
    });
    robot.updateMatrixWorld(true);
    const holder = new THREE.Group();
    const base = robot.links[spec.base_link];
    if (base) robot.applyMatrix4(base.matrixWorld.clone().invert());
    holder.add(robot);
    place(holder, spec.world_from_base);
    this.everything.add(holder);
    return { robot, joints: spec.joints, end: robot.links[spec.end_link] };
  }

  makePhantom({ size_m: [x, y, z], inclusions, target_in_world }) {
    const group = new THREE.Group();
    const glass = (tint, opacity) => new THREE.MeshStandardMaterial({ color: tint, transparent: true, opacity, depthWrite: false, side: THREE.DoubleSide });
    const block = new THREE.Mesh(new THREE.BoxGeometry(x, y, z), glass(0xd9b98c, 0.16));
    block.position.z = -z / 2;
    const edges = new THREE.LineSegments(new THREE.EdgesGeometry(block.geometry), new THREE.LineBasicMaterial({ color: 0x9a8460 }));
    edges.position.copy(block.position);
    group.add(block, edges);
    const tints = { clear_liquid: 0x4f8fd0, echogenic: 0xf4f4f4, bone: 0xf0e6cf };
    for (const body of inclusions) {
      let geometry;
      if (body.ellipsoid) geometry = new THREE.SphereGeometry(1, 24, 16).scale(...body.ellipsoid);
      else if (body.cylinder) geometry = new THREE.CylinderGeometry(body.cylinder[0], body.cylinder[0], body.cylinder[1], 24).rotateX(Math.PI / 2);
      else geometry = new THREE.BoxGeometry(...body.cuboid);
      const mesh = new THREE.Mesh(geometry, glass(tints[body.material] ?? 0xb0703c, body.cuboid ? 0.1 : 0.32));
      place(mesh, body.pose);
      group.add(mesh);
    }
    const target = new THREE.Mesh(new THREE.SphereGeometry(1.6e-3, 16, 12), new THREE.MeshBasicMaterial({ color: 0x40d660 }));
    target.position.set(...target_in_world);
    group.add(target);
    return group;
  }

  makeProbe({ columns_px: [left, right], image_px: [columns, rows], spacing_mm }) {
    const [width, depth] = [right - left, rows].map((px) => (px * spacing_mm) / 1e3);
    const group = new THREE.Group();
    const [more, thick, long] = HOUSING_M;
    const housing = new THREE.Mesh(new THREE.BoxGeometry(width + more, thick, long), new THREE.MeshStandardMaterial({ color: 0xe8ecef, transparent: true, opacity: 0.85 }));
    housing.position.z = -long / 2;
    this.texture = new THREE.CanvasTexture(this.image);
    this.texture.colorSpace = THREE.SRGBColorSpace;
    const plane = new THREE.Mesh(
      new THREE.PlaneGeometry(width, depth),
      new THREE.MeshBasicMaterial({ map: this.texture, side: THREE.DoubleSide, transparent: true, opacity: 0.94 }),
    );
    // The plane's own x and y become the probe's x and −z: the first row lies at the transducer.
    plane.rotation.x = -Math.PI / 2;
    plane.position.set((((left + right - columns) / 2) * spacing_mm) / 1e3, 0, depth / 2);
    const frame = new THREE.LineSegments(new THREE.EdgesGeometry(plane.geometry), new THREE.LineBasicMaterial({ color: 0x78aeff }));
    frame.rotation.copy(plane.rotation);
    frame.position.copy(plane.position);
    group.add(housing, plane, frame);
    return group;
  }

  show(state) {
    place(this.probe, state.world_from_probe);
    this.phantom.position.set(...state.phantom_mm.map((mm) => mm / 1e3));
    this.state = state;
    this.everything.visible = true;
    const turn = ({ robot, joints }, values) => joints.forEach((name, k) => robot.setJointValue(name, values[k]));
    turn(this.arm, state.arm_rad);
    if (this.needleRobot && state.needle_robot) turn(this.needleRobot, state.needle_robot);
    this.later();
  }

  drawHolder() {
    const flange = this.arm.end?.getWorldPosition(new THREE.Vector3());
    if (!flange) return;
    const housing = this.probe.localToWorld(new THREE.Vector3(0, 0, -HOUSING_M[2]));
    this.holder.position.copy(flange).add(housing).multiplyScalar(0.5);
    this.holder.scale.z = Math.max(flange.distanceTo(housing), 1e-4);
    this.holder.lookAt(housing);
  }

  drawNeedle() {
    const points = this.state.needle.map((p) => new THREE.Vector3(...p));
    this.needle.visible = points.length > 1;
    if (!this.needle.visible) return;
    const inside = points.slice(1).reduce((sum, p, k) => sum + p.distanceTo(points[k]), 0);
    const outside = Math.max(0, this.about.needle_length_m - inside);
    const back = points[0].clone().sub(points[1]).normalize().multiplyScalar(outside);
    points.unshift(points[0].clone().add(back));
    this.needle.geometry.dispose();
    this.needle.geometry = new THREE.TubeGeometry(new THREE.CatmullRomCurve3(points, false, "chordal"), 32, NEEDLE_RADIUS_M, 6);
    this.tip = points.at(-1);
    this.axis = points.at(-1).clone().sub(points.at(-2)).normalize();
  }

  view(name) {
    let view = VIEWS[name];
    if (name === "along") {
      if (!this.tip) return;
      view = { from: this.tip.clone().addScaledVector(this.axis, -0.2).toArray(), at: this.tip.toArray() };
    }
    this.camera.position.set(...view.from);
    this.controls.target.set(...view.at);
    this.near(view.near ?? NEAR_M);
    this.controls.update();
    this.later();
  }

  near(distance_m) {
    this.camera.near = distance_m;
    this.camera.updateProjectionMatrix();
  }

  size() {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.later();
  }

  later() {
    this.timer ??= setTimeout(() => {
      this.timer = null;
      requestAnimationFrame(() => this.draw());
    }, EVERY_MS);
  }

  draw() {
    if (this.state) {
      this.everything.updateMatrixWorld(true);
      this.drawHolder();
      this.drawNeedle();
      this.texture.needsUpdate = true;
    }
    this.renderer.setClearColor(colour("world"));
    this.renderer.render(this.scene, this.camera);
    this.canvas.dataset.drawn = String(Number(this.canvas.dataset.drawn ?? 0) + 1);
  }
}

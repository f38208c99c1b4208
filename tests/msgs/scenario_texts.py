"""Scenarios for tests to change: a climb with every key, and a walk."""

GOOD_TEXT = """\
version: 1
name: good
robot: scaler
wall: {slope_deg: 45, friction: 0.6}
contact: {model: patch, patch_radius_m: 0.02, max_normal_N: 60, spine_shear_N: 5, spine_twist_Nm: 0.05,
  spines_only: {RF: 2}}
holds:
  - {name: a, position_m: [0.14, 0.36], size_m: [0.06, 0.06, 0.06], yaw_deg: 0, friction: 2.2}
  - name: b
    position_m: [0.14, -0.36]
    size_m: [0.06, 0.06, 0.06]
    yaw_deg: 12
    friction: {+x: 2.2, -x: 2.1, +y: 0.0, -y: 0.0, top: 2.0}
    spines: {+y: false, -y: false}
  - {name: c, position_m: [-0.14, 0.36], size_m: [0.06, 0.06, 0.06], friction: 2.2, spines: false}
  - {name: d, position_m: [-0.14, -0.36], size_m: [0.06, 0.06, 0.06], friction: 2.2}
obstacles:
  - {name: pillar, position_m: [0.56, 0.36], size_m: [0.06, 0.06, 0.2], yaw_deg: 30}
start:
  body: {position_m: [0.0, 0.0, 0.185], rpy_deg: [0, 0, 0]}
  grasps: {LF: {hold: a, faces: x}, RF: {hold: b, faces: y}, LR: {hold: c, faces: x}, RR: {hold: d, faces: x}}
goal:
  body: {position_m: [0.2, 0.0, 0.185], rpy_deg: [0, 0, 5], tolerance_m: 0.02, tolerance_deg: 2}
  grasps: {LF: {hold: c, faces: x}}
horizon: {steps: 40, dt_s: 2.0}
planner: {method: multi_block, rho: 10, iterations: 5, limit_surface: inner,
  weights: {lift: 2}, margins: {friction: 0.1}}
"""
POINT_TEXT = """\
version: 1
name: walk
robot: scaler
wall: {slope_deg: 0}
contact: {model: point}
start: {body: {position_m: [0, 0, 0.185]}, feet: {LF: [0.1, 0.3], RF: [0.1, -0.3], LR: [-0.1, 0.3], RR: [-0.1, -0.3]}}
goal: {body: {position_m: [0.4, 0, 0.185]}}
horizon: {steps: 40, dt_s: 0.08}
"""

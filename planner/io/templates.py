"""The files that `octoplan new` writes: one for each command that takes a file, run as written."""

from __future__ import annotations

_PLAN = """\
#:schema scene.schema.json
# A scene for octoplan. For an editor that knows the keys: octoplan schema > scene.schema.json
#
#   octoplan plan FILE       which tendons to pull so that the [target] is met
#   octoplan settle FILE     the shape under `tensions`
#   octoplan stiffness FILE  how that shape answers to a force
#   octoplan effects FILE    which effects matter to that shape
#
# SI units, unless the key names another. What begins with # is off; the values there are examples.

accuracy = 1e-6                 # tip error over arm length, from 1e-12 to 0.1
# time_limit_s = 60.0           # then the best found by then is told; no limit unless given
# compile = "auto"             # by machine code, where there is a C compiler; or true, false
# norm = "2"                    # effort: "2" root of squares, "1" sum, "inf" largest tension
# stability_margin = 0.05       # under loads: the least stability of a plan, 1 at rest, 0 to stand
# clearance_mm = 2.0            # from obstacles; see below
# self_clearance = true         # as far from the arm itself and from behind its base plane
# form = "condensed"            # deprecated, has no effect
# solver = "ipopt"              # what solves the program: "auto", "ipopt" or "fatrop"
tensions = [                    # N, a row a section, tip first: for settle, stiffness, effects
  [0.0, 0.0, 0.5, 0.0],
  [4.0, 0.0, 0.0, 0.0],
  [0.0, 6.0, 0.0, 0.0],
]

# lengths_mm = [                # in place of tensions: what the winches leave of each tendon
#   [420.0, 420.0, 420.0, 420.0],
#   [300.0, 300.0, 300.0, 300.0],
#   [150.0, 150.0, 150.0, 150.0],
# ]
# strokes_mm = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]  # what they take in
# tendon_outside_mm = 100.0     # of each tendon, between winch and base

[arm]
preset = "table-4"              # "table-2", "table-4", "section-5.1", "section-5.2"
# An arm of your own in place of the preset:
# length_mm = 310.0
# radius_mm = [15.0, 6.5]       # base, tip; or { s_mm = [0, 100, 200, 310], values_mm = [...] }
# sections = [                  # where tendons end, from the tip to the base
#   { at_mm = 310.0, offset_mm = [7.5, 1.0] },    # distance from the midline: base, anchorage
#   { at_mm = 150.0, offset_mm = [5.0, 5.0], angles_deg = [0.0, 120.0, 240.0] },
#   # turn_deg = [0.0, 10.0] in one: tendons that turn along the arm, with loads;
#   # or { s_mm = [0, 50, 100, 150], values_deg = [...] }. This and offset_mm: of each tendon
#   # as a list, [[7.5, 1.0], [6.0, 1.0], ...]
# ]
# rest_curvature = { n = [0.0, 0.0], b = [1.0, 2.0] }  # 1/m at rest, about n and b: base, tip
#                               # or b = { s_mm = [0, 100, 200, 310], values = [...] }
# hull_mm = [16.0, 16.0]        # where discs hold tendons outside of the body
E_kPa = 110.0                   # Young's modulus
nu = 0.5                        # Poisson's ratio
density = 1080.0                # kg/m3
# base_position_mm = [0.0, 0.0, 0.0]
# base_rotation_deg = [0.0, 0.0, 0.0]  # of the base about its t, n, b
# base_frame = { tangent = [1.0, 0.0, 0.0], normal = [0.0, -1.0, 0.0] }

[effects]                       # nothing but bending, unless named here
silicone = true                 # what a real silicone arm calls for: all of the next three
# extension = true              # the arm shortens under its tendons: alone, the paper's scene
# exact_tendons = true
# neo_hookean = true
# anticlastic = true            # with neo_hookean
# as_printed = true             # the paper's equations to the letter; no other effects
# shear = { k_s = 1.0 }
# weight = { g = [0.0, 0.0, -9.81] }              # m/s2
# buoyancy = { density = 1000.0 }                 # kg/m3 of the water; with weight
# tip_load = { force = [0.0, 0.0, -0.005], moment = [0.0, 0.0, 0.0], follower = false }  # N, N m
# point_loads = [{ s_mm = 225.0, force = [0.0, 0.0, -0.005] }]
# contacts = [{ type = "half-space", point_mm = [0.0, 0.0, -40.0], normal = [0.0, 0.0, 1.0] }]
#                               # and friction = 0.3: between arm and obstacle
# self_contact = true           # parts of the arm that meet press each other apart; in settle
# point_masses = [{ s_mm = 225.0, mass_g = 2.0, offset_mm = [0.0, 12.0, 0.0] }]  # with weight
# current = { velocity = [0.0, 0.1, 0.0], density = 1000.0, coefficient = 1.1 }          # m/s
# friction = { mu = 0.1, direction = 1 }          # 1 pulling in, -1 paying out

[target]                        # several at once: [[targets]], a table each, in place of this
type = "tip-position"
position_mm = [200.0, 150.0, -200.0]
# type = "tip-pose"             # and position_mm
# tangent = [0.0, 0.0, -1.0]
# normal = [0.0, 1.0, 0.0]
# weights = [1.0, 1.0]          # of position and orientation, where not both can be had
# type = "tip-pointing"         # and position_mm, weights; roll is free
# direction = [0.0, 0.0, -1.0]
# type = "bending-plane"
# angle_deg = 135.0
# bend_deg = 90.0
# section = 1
# type = "fetch-reach"
# mouth_mm = [40.0, 60.0, -50.0]
# bend_deg = 70.0
# plane_deg = 90.0
# type = "fetch"                # [bend, plane] of each stretch
# proximal_deg = [60.0, 0.0]
# medial_deg = [50.0, 0.0]
# distal_deg = [40.0, 90.0]
# type = "backbone"
# points_mm = [[150.0, 0.0, 0.0], [300.0, 50.0, -50.0]]
# s_mm = [150.0, 320.0]
# weights = [1.0, 1.0]
# type = "minimum-stiffness"    # combined with one of those above
# direction = [0.0, 0.0, 1.0]   # or matrix = [[...], [...], [...]]
# value = 0.5                   # N/m
# hold = "tension"              # or "length", with tendon_EA if tendons stretch [N]
# type = "stiffest"             # or "softest": direction, hold
# type = "wrap"                 # length_mm or turns
# obstacle = { type = "sphere", center_mm = [250.0, 0.0, -45.0], radius_mm = 20.0 }
# length_mm = 150.0             # turns = 0.75 in its place
# turns = 0.75
# start_mm = 300.0              # where the part begins; it ends at the tip unless given
# tolerance = 0.25              # of the gap over the arm's radius
# type = "hold"                 # with obstacle, which is one of the contacts; friction
# force = [0.0, 0.0, 0.02]      # N, and moment N m if that is to be held too

[limits]
tension_max = 20.0              # N, each tendon; or a row a section, as in tensions
# tension_min = 0.0
# total_pull = 40.0
# stroke_max_mm = 20.0          # what winches take in from where they are zeroed
# stroke_zero = "straight"      # or "at rest": as the arm stands in the scene without tensions
# stroke_min_mm = -15.0         # how far they pay out; as much unless given

# [[obstacles]]                 # what plans and motions keep clear of, a table each
# type = "sphere"
# center_mm = [250.0, 100.0, 50.0]
# radius_mm = 20.0
# path_s_mm = [[0.0, 0.0, 0.0, 0.0], [2.0, 40.0, 0.0, 0.0]]  # [[obstacles]] in motions: s, then mm
# type = "capsule"              # and radius_mm
# start_mm = [150.0, 100.0, 50.0]
# end_mm = [150.0, 200.0, 50.0]
# type = "box"                  # center_mm, and tangent and normal of its edges
# size_mm = [10.0, 20.0, 30.0]
# type = "half-space"           # with its normal
# point_mm = [0.0, 0.0, -300.0]
# type = "mesh"                 # position_mm, tangent, normal: where the file's origin and axes are
# file = "body.stl"             # from where this file is; or, in its place, vertices_mm and faces
# unit = "mm"                   # of the file
# vertices_mm = [[300.0, 0.0, 0.0], [320.0, 0.0, 0.0], [300.0, 20.0, 0.0], [300.0, 0.0, 20.0]]
# faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]

# [[waypoints]]                 # targets in order, for octoplan trajectory
# type = "tip-position"
# position_mm = [300.0, 120.0, -120.0]
# [motion]
# rate_max = 5.0                # N/s
# stroke_rate_max_mm_s = 20.0
# stroke_acceleration_max_mm_s2 = 50.0   # then the arm rests at each waypoint
# quasi_static = true           # the tip accelerates by a tenth of gravity at most
# tip_acceleration_max_m_s2 = 0.5   # or by that
# times_s = [2.0]               # of each waypoint; then effort is made least, otherwise time

[stiffness]
hold = "tension"                # what holds the tendons; or "length"
# at_mm = 300.0                 # the tip unless given
# tendon_EA = 1000.0            # N, with lengths held
# release = false               # tendons without tension are held as well, with lengths held
"""

_SCENE = """\
[scene.arm]
preset = "table-4"              # "table-2", "table-4", "section-5.1", "section-5.2"; or length_mm,
                                # radius_mm and sections of your own
E_kPa = 110.0                   # Young's modulus
[scene.effects]
silicone = true                 # what a real silicone arm calls for
# weight = { g = [0.0, 0.0, -9.81] }              # m/s2
# buoyancy = { density = 1000.0 }                 # kg/m3 of the water; with weight
"""

_TRAJECTORY = """\
#:schema scene.schema.json
# A motion for octoplan:  octoplan trajectory FILE --out DIR
# All keys: octoplan new; for an editor that knows them: octoplan schema > scene.schema.json
# SI units, unless the key names another. What begins with # is off; the values there are examples.

accuracy = 1e-5                 # tip error over arm length
# clearance_mm = 2.0            # from obstacles
# self_clearance = true         # as far from the arm itself and from behind its base plane

[arm]
preset = "table-4"              # "table-2", "table-4", "section-5.1", "section-5.2"

[effects]
silicone = true                 # what a real silicone arm calls for
# weight = { g = [0.0, 0.0, -9.81] }              # m/s2
# buoyancy = { density = 1000.0 }                 # kg/m3 of the water; with weight

[limits]
tension_max = 20.0              # N, each tendon
# stroke_max_mm = 20.0          # what winches take in from where they are zeroed

[motion]
rate_max = 5.0                  # N/s
# stroke_rate_max_mm_s = 20.0
# stroke_acceleration_max_mm_s2 = 50.0   # then the arm rests at each waypoint
# quasi_static = true           # the tip accelerates by a tenth of gravity at most
# tip_acceleration_max_m_s2 = 0.5   # or by that
# times_s = [2.0, 4.0]          # of each waypoint; then effort is made least, otherwise time

[[waypoints]]                   # targets in order; any type that [target] has
type = "tip-position"
position_mm = [200.0, 150.0, -200.0]

[[waypoints]]
type = "tip-position"
position_mm = [250.0, 150.0, -150.0]

# [[obstacles]]                 # what the arm keeps clear of, a table each
# type = "sphere"
# center_mm = [250.0, 100.0, 50.0]
# radius_mm = 20.0
# path_s_mm = [[0.0, 0.0, 0.0, 0.0], [2.0, 40.0, 0.0, 0.0]]   # it may move: s, then mm
"""

_SWEEP = (
    """\
# A sweep for octoplan:  octoplan sweep FILE --out sweep.nc --jobs -1
# A scene at many of its values: all grids by all others, and drawn values jointly with them.
# The scene may stand in a file of its own: scene = "scene.toml" in place of the tables.

[scene]
tensions = [                    # N, a row a section, tip first
  [0.0, 0.0, 0.5, 0.0],
  [2.0, 0.0, 0.0, 0.0],
  [0.0, 3.0, 0.0, 0.0],
]
"""
    + _SCENE
    + """
[sweep]
compute = "settle"              # or "plan", with [scene.target] and [scene.limits]; "stiffness"
# draws = 100                   # how many times drawn values are drawn, together
# seed = 0

[[sweep.axes]]
key = "arm.E_kPa"               # the path of a value in the scene; values are in its unit
values = [100.0, 110.0, 120.0]

[[sweep.axes]]
key = "tensions[1][0]"
start = 0.0
stop = 4.0
count = 5

# [[sweep.axes]]
# key = "arm.density"
# distribution = "normal"       # or "uniform", "log-uniform" with low and high
# mean = 1080.0
# sd = 20.0
"""
)

_CALIBRATE = (
    """\
# A calibration for octoplan:  octoplan calibrate FILE
# Numbers of an arm, found from shapes that were measured under known tensions.
# The scene may stand in a file of its own: scene = "scene.toml" in place of the tables.

measured = "{measured}"         # a shape a line, beside this file; its columns name the units
std_mm = 1.0                    # standard deviation of places, of shapes against each other
# absolute_std = true           # that holds as it is
# loss = "soft_l1"              # robust against outliers; or "huber", "cauchy"
# starts = 5                    # fits from so many values within the bounds
# accuracy = 1e-5

"""
    + _SCENE
    + """
[[points]]                      # markers, by their names in the columns
name = "M1"
s_mm = 315.0                    # arc length from the base
# offset_mm = [0.0, 5.0, 0.0]   # from the midline, along t, n, b

[[unknowns]]                    # by the path of a number in the scene, in its unit
key = "arm.E_kPa"
lower = 50.0
upper = 300.0
# prior = [110.0, 20.0]         # mean and standard deviation known beforehand

# [[unknowns]]
# key = "points[0].s_mm"        # also where markers are, and tension_scale[0] of a tendon
# lower = 305.0
# upper = 325.0
"""
)

# Tips and a marker of the arm in _CALIBRATE, of 125 kPa, rounded to what a camera tells.
_SHAPES = """\
name,{tendons},M1_x_mm,M1_y_mm,M1_z_mm,tip_x_mm,tip_y_mm,tip_z_mm
first,{one},239.6,-103.9,0.0,259.7,-153.6,0.0
second,{two},86.5,-103.8,-85.1,69.2,-101.6,-34.4
third,{three},128.5,112.6,54.1,150.5,85.6,27.7
""".format(
    tendons=",".join(f"T_{i}{j}_N" for i in (1, 2, 3) for j in (1, 2, 3, 4)),
    one="0,0,0.5,0,2,0,0,0,0,0,0,0",
    two="0,0,0.5,0,4,0,0,0,0,6,0,0",
    three="0,0.8,0,0,0,0,3,0,0,0,0,5",
)

_DESIGN = (
    """\
# A design for octoplan:  octoplan design FILE
# The arm for which several tasks take least effort, by numbers of it that may change.
# The scene may stand in a file of its own: scene = "scene.toml" in place of the tables.

"""
    + _SCENE
    + """
[scene.limits]
tension_max = 20.0              # N, each tendon

[[tasks]]                       # a target each; any type that a scene's [target] has
type = "tip-position"
position_mm = [200.0, 150.0, -200.0]

[[tasks]]
type = "tip-position"
position_mm = [250.0, 150.0, -150.0]

[[unknowns]]                    # by the path of a number in the scene, in its unit
key = "arm.sections[2].offset_mm[0]"
lower = 4.0
upper = 9.0

# [making]                      # what can be made
# wall_mm = 1.0                 # least, around a tendon
# radius_mm = 2.0               # least, of the body
# spacing_mm = 20.0             # least, of the anchorages
# [objective]                   # in place of least effort; or type = "softest", "reach"
# type = "stiffest"
# direction = [0.0, 0.0, 1.0]
"""
)

TEMPLATES = {
    "plan": _PLAN,
    "trajectory": _TRAJECTORY,
    "sweep": _SWEEP,
    "calibrate": _CALIBRATE,
    "design": _DESIGN,
}
"""What `octoplan new --kind` writes."""


def first_files(kind: str, name: str) -> dict[str, str]:
    """Return the files to start from: one of a kind by its name, and what it needs beside it."""
    text = TEMPLATES[kind]
    if kind != "calibrate":
        return {name: text}
    beside = f"{name.removesuffix('.toml')}_shapes.csv"
    return {name: text.replace("{measured}", beside), beside: _SHAPES}

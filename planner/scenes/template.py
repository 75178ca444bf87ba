"""The scene file that `octoplan new` writes."""

TEMPLATE = """\
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
extension = true                # the arm shortens under its tendons
# silicone = true               # what a real silicone arm calls for: this and the next two
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
# times_s = [2.0]               # of each waypoint; then effort is made least, otherwise time

[stiffness]
hold = "tension"                # what holds the tendons; or "length"
# at_mm = 300.0                 # the tip unless given
# tendon_EA = 1000.0            # N, with lengths held
# release = true                # tendons without tension are slack, with lengths held
"""

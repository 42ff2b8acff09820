"""A database of somebody else's steering messages, and mapping files for it."""

DBC = """VERSION ""
BU_: A B
BO_ 288 MOTOROLA: 8 A
 SG_ Angle : 6|15@0- (0.1,0) [-1638.4|1638.3] "deg" B
 SG_ Request : 16|2@1+ (1,0) [0|3] "" B
 SG_ Mode M : 24|4@1+ (1,0) [0|15] "" B
 SG_ Speed m2 : 32|12@1+ (0.1,0) [0|409.5] "km/h" B
 SG_ Other m3 : 32|12@1+ (1,0) [0|4095] "" B
 SG_ Counter : 48|4@1+ (1,0) [0|15] "" B
 SG_ Checksum : 63|8@0+ (1,0) [0|255] "" B
BO_ 2566834800 LONG: 24 A
 SG_ Curve : 24|15@1+ (6.7E-006,0) [0|0.219] "rad/m" B
 SG_ Curve_VZ : 39|1@1+ (1,0) [0|1] "" B
 SG_ On : 12|4@1+ (1,0) [0|15] "" B
BO_ 304 BACK: 8 B
 SG_ Wheel : 7|16@0- (0.05,0) [0|1] "deg" A
 SG_ State : 16|4@1+ (1,0) [0|15] "" A
 SG_ Fault : 20|1@1+ (1,0) [0|1] "" A
 SG_ Vel : 24|16@1+ (0.01,0) [0|655.35] "km/h" A
 SG_ Yaw : 40|16@1- (0.01,0) [-327|327] "deg/s" A
 SG_ Alive : 56|8@1+ (1,0) [0|255] "" A
"""
MOTOROLA = """
[command]
message = "MOTOROLA"
angle = { signal = "Angle", ratio = 15.0, positive = "right" }
speed = { signal = "Speed" }
enable = [{ signal = "Request", on = 2, off = 1 }]
constants = { Mode = 2 }
counter = { signal = "Counter", last = 14, skip = [7] }
checksum = { signal = "Checksum", rule = "xor", initial = 165 }
[[feedback]]
message = "BACK"
cycle_ms = 20
angle = { signal = "Wheel", ratio = 15.0 }
speed = { signal = "Vel" }
yaw_rate = { signal = "Yaw" }
state = { signal = "State", values = { ACTIVE = [3, 4], STANDBY = [1], FAULT = [9] } }
fault = { signal = "Fault" }
counter = { signal = "Alive" }
"""
LONG = """
[command]
message = "LONG"
cycle_ms = 20
wheelbase = 2.5
curvature = { signal = "Curve", sign = { signal = "Curve_VZ" } }
enable = [{ signal = "On", on = 4, off = 2 }]
"""

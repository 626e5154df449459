"""MAVLink as far as this program needs it: field layouts of the messages it reads, checksum extras of all others.

pymavlink's dialect modules hold a class for every message and a text for every enum: 18 MiB and a tenth of a second on
the way to the first heartbeat. These numbers are theirs; ``tests/companion/test_definitions.py`` compares every one.
"""

from __future__ import annotations

from typing import NamedTuple

CRC_EXTRAS = {
    0: 50, 1: 124, 2: 137, 4: 237, 5: 217, 6: 104, 7: 119, 11: 89, 20: 214, 21: 159, 22: 220, 23: 168, 24: 24, 25:
    23, 26: 170, 27: 144, 28: 67, 29: 115, 30: 39, 31: 246, 32: 185, 33: 104, 34: 237, 35: 244, 36: 222, 37: 212,
    38: 9, 39: 254, 40: 230, 41: 28, 42: 28, 43: 132, 44: 221, 45: 232, 46: 11, 47: 153, 48: 41, 49: 39, 50: 78, 51:
    196, 54: 15, 55: 3, 61: 167, 62: 183, 63: 119, 64: 191, 65: 118, 66: 148, 67: 21, 69: 243, 70: 124, 73: 38, 74:
    20, 75: 158, 76: 152, 77: 143, 81: 106, 82: 49, 83: 22, 84: 143, 85: 140, 86: 5, 87: 150, 89: 231, 90: 183, 91:
    63, 92: 54, 93: 47, 100: 175, 101: 102, 102: 158, 103: 208, 104: 56, 105: 93, 106: 138, 107: 108, 108: 32, 109:
    185, 110: 84, 111: 34, 112: 174, 113: 124, 114: 237, 115: 4, 116: 76, 117: 128, 118: 56, 119: 116, 120: 134,
    121: 237, 122: 203, 123: 250, 124: 87, 125: 203, 126: 220, 127: 25, 128: 226, 129: 46, 130: 29, 131: 223, 132:
    85, 133: 6, 134: 229, 135: 203, 136: 1, 137: 195, 138: 109, 139: 168, 140: 181, 141: 47, 142: 72, 143: 131, 144:
    127, 146: 103, 147: 154, 148: 178, 149: 200, 150: 134, 151: 219, 152: 208, 153: 188, 154: 84, 155: 22, 156: 19,
    157: 21, 158: 134, 160: 78, 161: 68, 162: 189, 163: 127, 164: 154, 165: 21, 166: 21, 167: 144, 168: 1, 169: 234,
    170: 73, 171: 181, 172: 22, 173: 83, 174: 167, 175: 138, 176: 234, 177: 240, 178: 47, 179: 189, 180: 52, 181:
    174, 182: 229, 183: 85, 184: 159, 185: 186, 186: 72, 191: 92, 192: 36, 193: 71, 194: 98, 195: 120, 200: 134,
    201: 205, 214: 69, 215: 101, 216: 50, 217: 202, 218: 17, 219: 162, 225: 208, 226: 207, 230: 163, 231: 105, 232:
    151, 233: 35, 234: 150, 235: 179, 241: 90, 242: 104, 243: 85, 244: 95, 245: 130, 246: 184, 247: 81, 248: 8, 249:
    204, 250: 49, 251: 170, 252: 44, 253: 83, 254: 46, 256: 71, 257: 131, 258: 187, 259: 92, 260: 146, 261: 179,
    262: 12, 263: 133, 264: 49, 265: 26, 266: 193, 267: 35, 268: 14, 269: 109, 270: 59, 271: 22, 275: 126, 276: 18,
    277: 62, 280: 70, 281: 48, 282: 123, 283: 74, 284: 99, 285: 137, 286: 210, 287: 1, 288: 20, 295: 234, 296: 158,
    299: 19, 301: 243, 310: 28, 311: 95, 320: 243, 321: 88, 322: 243, 323: 78, 324: 132, 330: 23, 331: 91, 332: 236,
    333: 231, 335: 225, 339: 199, 340: 99, 345: 209, 350: 232, 360: 11, 370: 75, 373: 117, 375: 251, 376: 199, 385:
    147, 386: 132, 387: 4, 388: 8, 390: 156, 9000: 113, 9005: 117, 10001: 209, 10002: 186, 10003: 4, 10004: 133,
    10005: 103, 10006: 193, 10007: 71, 10008: 240, 10151: 195, 11000: 134, 11001: 15, 11002: 234, 11003: 64, 11004:
    11, 11005: 93, 11010: 46, 11011: 106, 11020: 205, 11030: 144, 11031: 133, 11032: 85, 11033: 195, 11034: 79,
    11035: 128, 11036: 177, 11037: 130, 11038: 47, 11039: 142, 11040: 132, 11041: 208, 11042: 201, 11043: 193,
    11044: 189, 11060: 162, 12900: 114, 12901: 254, 12902: 140, 12903: 249, 12904: 77, 12905: 49, 12915: 94, 12918:
    139, 12919: 7, 12920: 20, 42000: 227, 42001: 239, 50001: 246, 50002: 181, 50003: 62, 50004: 240, 50005: 152,
    52000: 13, 52001: 239,
}  # fmt: skip
"""Checksum extra of every message of the ardupilotmega dialect, by id."""


class Definition(NamedTuple):
    """Name, and the payload as on the wire with its extension fields: struct format, and field names in that order."""

    name: str
    format: str
    fields: tuple[str, ...]


def _of(name: str, format: str, fields: str) -> Definition:
    return Definition(name, format, tuple(fields.split()))


MESSAGES = {
    0: _of("HEARTBEAT", "<IBBBBB",
        "custom_mode type autopilot base_mode system_status mavlink_version"),
    1: _of("SYS_STATUS", "<IIIHHhHHHHHHbIII",
        "onboard_control_sensors_present onboard_control_sensors_enabled onboard_control_sensors_health load "
        "voltage_battery current_battery drop_rate_comm errors_comm errors_count1 errors_count2 errors_count3 "
        "errors_count4 battery_remaining onboard_control_sensors_present_extended "
        "onboard_control_sensors_enabled_extended onboard_control_sensors_health_extended"),
    22: _of("PARAM_VALUE", "<fHH16sB",
        "param_value param_count param_index param_id param_type"),
    26: _of("SCALED_IMU", "<Ihhhhhhhhhh",
        "time_boot_ms xacc yacc zacc xgyro ygyro zgyro xmag ymag zmag temperature"),
    27: _of("RAW_IMU", "<QhhhhhhhhhBh",
        "time_usec xacc yacc zacc xgyro ygyro zgyro xmag ymag zmag id temperature"),
    29: _of("SCALED_PRESSURE", "<Iffhh",
        "time_boot_ms press_abs press_diff temperature temperature_press_diff"),
    30: _of("ATTITUDE", "<Iffffff",
        "time_boot_ms roll pitch yaw rollspeed pitchspeed yawspeed"),
    31: _of("ATTITUDE_QUATERNION", "<Ifffffff4f",
        "time_boot_ms q1 q2 q3 q4 rollspeed pitchspeed yawspeed repr_offset_q"),
    32: _of("LOCAL_POSITION_NED", "<Iffffff",
        "time_boot_ms x y z vx vy vz"),
    36: _of("SERVO_OUTPUT_RAW", "<IHHHHHHHHBHHHHHHHH",
        "time_usec servo1_raw servo2_raw servo3_raw servo4_raw servo5_raw servo6_raw servo7_raw servo8_raw "
        "port servo9_raw servo10_raw servo11_raw servo12_raw servo13_raw servo14_raw servo15_raw servo16_raw"),
    77: _of("COMMAND_ACK", "<HBBiBB",
        "command result progress result_param2 target_system target_component"),
    82: _of("SET_ATTITUDE_TARGET", "<I4fffffBBB",
        "time_boot_ms q body_roll_rate body_pitch_rate body_yaw_rate thrust target_system target_component "
        "type_mask"),
    83: _of("ATTITUDE_TARGET", "<I4fffffB",
        "time_boot_ms q body_roll_rate body_pitch_rate body_yaw_rate thrust type_mask"),
    84: _of("SET_POSITION_TARGET_LOCAL_NED", "<IfffffffffffHBBB",
        "time_boot_ms x y z vx vy vz afx afy afz yaw yaw_rate type_mask target_system target_component "
        "coordinate_frame"),
    105: _of("HIGHRES_IMU", "<QfffffffffffffHB",
        "time_usec xacc yacc zacc xgyro ygyro zgyro xmag ymag zmag abs_pressure diff_pressure pressure_alt "
        "temperature fields_updated id"),
    111: _of("TIMESYNC", "<qq",
        "tc1 ts1"),
    116: _of("SCALED_IMU2", "<Ihhhhhhhhhh",
        "time_boot_ms xacc yacc zacc xgyro ygyro zgyro xmag ymag zmag temperature"),
    129: _of("SCALED_IMU3", "<Ihhhhhhhhhh",
        "time_boot_ms xacc yacc zacc xgyro ygyro zgyro xmag ymag zmag temperature"),
    132: _of("DISTANCE_SENSOR", "<IHHHBBBBff4fB",
        "time_boot_ms min_distance max_distance current_distance type id orientation covariance "
        "horizontal_fov vertical_fov quaternion signal_quality"),
    137: _of("SCALED_PRESSURE2", "<Iffhh",
        "time_boot_ms press_abs press_diff temperature temperature_press_diff"),
    143: _of("SCALED_PRESSURE3", "<Iffhh",
        "time_boot_ms press_abs press_diff temperature temperature_press_diff"),
    147: _of("BATTERY_STATUS", "<iih10HhBBBbiB4HBI",
        "current_consumed energy_consumed temperature voltages current_battery id battery_function type "
        "battery_remaining time_remaining charge_state voltages_ext mode fault_bitmask"),
    168: _of("WIND", "<fff",
        "direction speed speed_z"),
    173: _of("RANGEFINDER", "<ff",
        "distance voltage"),
    193: _of("EKF_STATUS_REPORT", "<fffffHf",
        "velocity_variance pos_horiz_variance pos_vert_variance compass_variance terrain_alt_variance flags "
        "airspeed_variance"),
    226: _of("RPM", "<ff",
        "rpm1 rpm2"),
    230: _of("ESTIMATOR_STATUS", "<QffffffffH",
        "time_usec vel_ratio pos_horiz_ratio pos_vert_ratio mag_ratio hagl_ratio tas_ratio pos_horiz_accuracy "
        "pos_vert_accuracy flags"),
    231: _of("WIND_COV", "<Qffffffff",
        "time_usec wind_x wind_y wind_z var_horiz var_vert wind_alt horiz_accuracy vert_accuracy"),
    241: _of("VIBRATION", "<QfffIII",
        "time_usec vibration_x vibration_y vibration_z clipping_0 clipping_1 clipping_2"),
    245: _of("EXTENDED_SYS_STATE", "<BB",
        "vtol_state landed_state"),
    253: _of("STATUSTEXT", "<B50sHB",
        "severity text id chunk_seq"),
    339: _of("RAW_RPM", "<fB",
        "frequency index"),
    11030: _of("ESC_TELEMETRY_1_TO_4", "<4H4H4H4H4H4B",
        "voltage current totalcurrent rpm count temperature"),
    11031: _of("ESC_TELEMETRY_5_TO_8", "<4H4H4H4H4H4B",
        "voltage current totalcurrent rpm count temperature"),
    11032: _of("ESC_TELEMETRY_9_TO_12", "<4H4H4H4H4H4B",
        "voltage current totalcurrent rpm count temperature"),
    11040: _of("ESC_TELEMETRY_13_TO_16", "<4H4H4H4H4H4B",
        "voltage current totalcurrent rpm count temperature"),
    11041: _of("ESC_TELEMETRY_17_TO_20", "<4H4H4H4H4H4B",
        "voltage current totalcurrent rpm count temperature"),
    11042: _of("ESC_TELEMETRY_21_TO_24", "<4H4H4H4H4H4B",
        "voltage current totalcurrent rpm count temperature"),
    11043: _of("ESC_TELEMETRY_25_TO_28", "<4H4H4H4H4H4B",
        "voltage current totalcurrent rpm count temperature"),
    11044: _of("ESC_TELEMETRY_29_TO_32", "<4H4H4H4H4H4B",
        "voltage current totalcurrent rpm count temperature"),
}  # fmt: skip
"""Messages that are decoded in flight, by id; ESC_INFO and ESC_STATUS are in esc_messages.py."""

ID_OF = {definition.name: number for number, definition in MESSAGES.items()}

PITCH_YAW_DEG = {
    0: (0, 0), 1: (0, 45), 2: (0, 90), 3: (0, 135), 4: (0, 180), 5: (0, 225), 6: (0, 270), 7: (0, 315), 8: (0, 0),
    9: (0, 45), 10: (0, 90), 11: (0, 135), 12: (180, 0), 13: (0, 225), 14: (0, 270), 15: (0, 315), 16: (0, 0), 17:
    (0, 45), 18: (0, 90), 19: (0, 135), 20: (0, 0), 21: (0, 45), 22: (0, 90), 23: (0, 135), 24: (90, 0), 25: (270,
    0), 26: (180, 90), 27: (180, 270), 28: (90, 0), 29: (90, 0), 30: (90, 0), 31: (180, 0), 32: (180, 0), 33: (270,
    0), 34: (270, 0), 35: (270, 0), 36: (180, 90), 37: (0, 270), 38: (68, 293), 39: (315, 0), 40: (315, 0),
}  # fmt: skip
"""Pitch and yaw of every MAV_SENSOR_ORIENTATION by its name; roll does not turn a beam."""

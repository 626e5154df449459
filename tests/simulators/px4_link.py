"""How PX4 speaks: its own modes, its own messages of the rotors and of the estimator, setpoints heard in every mode."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from arducopter_link import ArduCopterLink
from px4 import Px4
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.mavlink.esc_messages import ESC_INFO, ESC_STATUS, EscMessage
from companion.mavlink.wire_frames import pack
from companion.sim.autopilot import Mode
from companion.sim.link import AUTOPILOT, SYSTEM, Messages

PX4_MODES = {
    Mode.GUIDED: (6, 0),  # OFFBOARD
    Mode.TAKEOFF: (4, 2),
    Mode.LOITER: (4, 3),  # Hold
    Mode.RTL: (4, 5),
    Mode.LAND: (4, 6),
    Mode.POSHOLD: (3, 0),  # Position
    Mode.ALT_HOLD: (2, 0),
    Mode.STABILIZE: (7, 0),
}
"""PX4's (main, sub) mode of each of ours."""


@dataclass(frozen=True)
class _EscMessage:
    """A message that pymavlink lacks."""

    kind: EscMessage
    fields: tuple[float, ...]

    def pack(self, mav: Any) -> bytes:
        """The frame, numbered as all others of this sender."""
        frame = pack(
            self.kind.id, self.kind.unpacker.pack(*self.fields), SYSTEM, AUTOPILOT, mav.seq
        )
        mav.seq = (mav.seq + 1) % 256
        return frame


class Px4Link(ArduCopterLink):
    """The link of a ``Px4``."""

    messages_per_s = 573.0
    """On PX4's onboard link, as measured on the real one."""
    firmware = mavlink.MAV_AUTOPILOT_PX4
    range_covariance = 0
    says_mode_at_once = False
    frames = (mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_BODY_NED)

    @property
    def _px4(self) -> Px4:
        assert isinstance(self._flight.autopilot, Px4)
        return self._flight.autopilot

    # -- out --------------------------------------------------------------------------------------------------------

    def mode_numbers(self, mode: Mode) -> tuple[int, int]:
        """Main and sub mode of MAV_CMD_DO_SET_MODE."""
        return PX4_MODES[mode]

    def _custom_mode(self) -> int:
        main, sub = PX4_MODES.get(self._px4.mode, (7, 0))
        return main << 16 | sub << 24

    def _message_table(self) -> dict[int, Callable[[], Messages]]:
        table = super()._message_table()
        table[mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS] = table.pop(
            mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT
        )
        if table.pop(mavlink.MAVLINK_MSG_ID_ESC_TELEMETRY_1_TO_4, None):
            table |= {ESC_STATUS.id: self._esc_status, ESC_INFO.id: self._esc_info}
        return table

    def _estimator_status(self) -> Messages:
        estimator = self._estimator
        tests = (0.05, estimator.test_ratio if estimator.trusted else 0.05, 0.05, 0.05, 0.05, 0.05)
        error_m = 0.3 if estimator.trusted else 5.0
        return [
            mavlink.MAVLink_estimator_status_message(
                self.boot_us, self._position_flags(), *tests, error_m, 0.3
            )
        ]

    def _esc_status(self) -> Messages:
        f, rpm = self._flight, self._esc_rpm()
        volts, amps = f.body.pack.voltage_v, f.body.pack.current_a / len(f.body.rpm)
        return [
            _EscMessage(
                ESC_STATUS,
                (self.boot_us, *(round(v) for v in rpm[i : i + 4]), *[volts] * 4, *[amps] * 4, i),
            )
            for i in range(0, len(rpm), 4)
        ]

    def _esc_info(self) -> Messages:
        f, rpm = self._flight, self._esc_rpm()
        temperature, count = round(100.0 * f.esc.temperature_c), len(f.body.rpm)
        heard, online = f.esc.count & 0xFFFF, (1 << count) - 1 & 0xFF
        return [
            _EscMessage(
                ESC_INFO,
                (self.boot_us, *[0] * 4, heard, *[0] * 4, *[temperature] * 4, i, count, 5, online),
            )
            for i in range(0, len(rpm), 4)
        ]

    # -- in ---------------------------------------------------------------------------------------------------------

    def _for_us(self, message: Any) -> bool:
        return getattr(message, "target_component", 0) in (0, AUTOPILOT)

    def _on_set_attitude_target(self, m: Any) -> None:
        self._px4.stream_heard()
        super()._on_set_attitude_target(m)

    def _on_set_position_target_local_ned(self, m: Any) -> None:
        self._px4.stream_heard()
        super()._on_set_position_target_local_ned(m)

    def _on_request_data_stream(self, m: Any) -> None:
        """Not PX4's."""

    def _take_off(self, height_m: float) -> bool:
        return self._px4.take_off(height_m, self._flight.estimate)

    def _set_mode(self, main: int, sub: int) -> bool:
        codes = [(mode, code) for mode, code in PX4_MODES.items() if code[0] == main]
        match = [mode for mode, code in codes if code[1] in (sub, 0)]
        if not match or (match[0] is Mode.GUIDED and not self._px4.stream_runs):
            return False
        self._px4.set_mode(match[0], self._flight.estimate)
        return True

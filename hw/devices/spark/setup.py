"""A SPARK's status frames turned on and its parameters set, after every start and reset, until it confirms them."""

from collections.abc import Mapping

from truearc.hw import fault_codes as codes
from truearc.hw.devices.spark import frames as spark
from truearc.hw.protocols import Frame
from truearc.hw.reason import Reason

MS = 1_000_000
RETRY_NS = 100 * MS                   # how often a question without an answer is asked again
STALE_NS = 100 * MS                   # what is older than this is not driven by; a status frame that is on is younger


class SparkSetup:
    """Some status frames and parameters of one device.

    statuses: bit n: STATUS_n. settings: parameter -> value. takers: message -> what takes its frame; BadFrame from it.
    """

    def __init__(self, axis: spark.SparkAxis, statuses: int, settings: Mapping[int, float]) -> None:
        self.takers = {"GET_FIRMWARE_VERSION": self.take_version, "PARAMETER_WRITE_RESPONSE": self.take_setting,
                       "SET_STATUSES_ENABLED_RESPONSE": self._take_statuses}
        self._axis, self._statuses, self._settings = axis, statuses, settings
        self._asked_ns = -RETRY_NS
        self._statuses_ns = 0                     # since then a status frame has had a chance to come
        self.forget()

    def forget(self) -> None:
        """Whatever was confirmed may be lost."""
        self._version: tuple[int, int, int] | None = None
        self._statuses_on = False
        self._unset = dict(self._settings)        # settings that the device has not confirmed

    @property
    def is_ready(self) -> bool:
        return self._speaks_our_frames() and self._statuses_on and not self._unset

    def frames(self, t_ns: int, heard_ns: int) -> list[Frame]:
        """Once a tick: the next question on the way to a device that is ready; none while an answer may still come.

        heard_ns: when a status frame of those last came. Where they were on and stay away the device has been reset.
        """
        if self._statuses_on and t_ns - max(heard_ns, self._statuses_ns) > STALE_NS:
            self.forget()
        if self.is_ready or t_ns - self._asked_ns < RETRY_NS:
            return []
        self._asked_ns = t_ns
        if not self._speaks_our_frames():         # a refused one too: it may be exchanged or updated
            return [spark.make_version_query(self._axis)]
        if not self._statuses_on:
            return [spark.make_statuses(self._axis, self._statuses)]
        return [spark.make_setting(self._axis, parameter, value) for parameter, value in self._unset.items()]

    def fault(self) -> Reason | None:
        """Why the device is not ready."""
        device = self._axis.device
        if self._version is None:
            return codes.SPARK_FIRMWARE_UNKNOWN(spark=device)
        if not self._speaks_our_frames():
            return codes.SPARK_FIRMWARE_UNSUPPORTED(spark=device, version=".".join(map(str, self._version)),
                                              oldest=spark.OLDEST_FIRMWARE, newest=spark.NEWEST_FIRMWARE)
        if not self._statuses_on:
            return codes.SPARK_STATUS_OFF(spark=device)
        if self._unset:
            return codes.SPARK_SETTINGS_UNCONFIRMED(spark=device, parameters=tuple(self._unset))
        return None

    def _speaks_our_frames(self) -> bool:
        return self._version is not None and (spark.OLDEST_FIRMWARE <= self._version[0] <= spark.NEWEST_FIRMWARE)

    def take_version(self, frame: Frame) -> None:
        """An answer to its question who the device is; BadFrame for anything else."""
        spoke, self._version = self._speaks_our_frames(), spark.parse_version(self._axis, frame)
        if self._speaks_our_frames() and not spoke:
            self._asked_ns = -RETRY_NS            # the next question need not wait

    def _take_statuses(self, frame: Frame) -> None:
        were_on = self._statuses_on
        self._statuses_on = spark.parse_statuses(self._axis, frame) & self._statuses == self._statuses
        self._statuses_ns = frame.t_ns
        if self._statuses_on and not were_on:
            self._asked_ns = -RETRY_NS

    def take_setting(self, frame: Frame) -> tuple[int, float] | None:
        """An answer to a parameter that was written; as spark.parse_setting."""
        answer = spark.parse_setting(self._axis, frame)
        if answer is None or answer[0] not in self._unset:
            return answer
        parameter, value = answer
        if spark.setting_bits(parameter, self._unset[parameter]) == spark.setting_bits(parameter, value):
            del self._unset[parameter]
        return answer

"""What Windows and macOS lack, taken from a Linux interpreter that finds this folder in PYTHONPATH.

Modules, names of `os`, `signal` and `socket`, devices and SocketCAN are gone for every package, as on those systems; an
open file can be neither removed nor replaced, as on Windows; a text file that names no encoding is an error. Code of
truearc sees `sys.platform` and `os.name` of Windows. Others keep Linux's, because they then look for Windows' files.
"""

import contextlib
import importlib._bootstrap
import importlib.abc
import os
import re
import shutil
import signal
import socket
import sys
import types
import warnings

MODULES = {"fcntl", "termios", "tty", "pty", "resource", "grp", "pwd", "spwd", "crypt", "syslog", "curses", "readline"}
GONE = {os: r"sched_.*|SCHED_.*|fork|forkpty|openpty|mkfifo|mknod|get(e?uid|e?gid|groups|pgid|sid|loadavg|priority)|"
            r"set(uid|gid|sid|pgid|priority)|killpg|nice|chown|fchown|chroot|ttyname|memfd_create|eventfd|pread|pwrite|"
            r"posix_.*|O_NONBLOCK|O_NOCTTY|O_DIRECTORY|O_SYNC",
        signal: r"SIG(USR1|USR2|HUP|QUIT|ALRM|CHLD|CONT|TSTP|WINCH)|alarm|[sg]etitimer|pause|sigwait.*|pthread_.*",
        socket: r"(AF|PF|CAN)_(CAN|RAW|BCM|ISOTP|NETLINK|PACKET).*|CAN_.*"}
FAMILIES = {16, 17, 29}                           # netlink, packet, CAN, by number
DEVICES = re.compile(r"/(dev/(?!null$|urandom$|random$)|proc/|sys/)")
WRONG_NAME = re.compile(r"[<>:\"|?*\x00-\x1f]|[. ]$")
READ_ONLY = os.O_RDONLY | os.O_CLOEXEC
_list, _read = os.listdir, os.readlink
_inside = [False]


class Blocked(importlib.abc.MetaPathFinder):
    """Refuses modules that only POSIX has."""

    def find_spec(self, name, path, target=None):
        if name.partition(".")[0] in MODULES:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return None


def _seen(real, elsewhere):
    """A property that is `elsewhere` for code of truearc and `real` for all other."""
    return property(lambda module: elsewhere if sys._getframe(1).f_globals.get("__name__", "").startswith("truearc")
                    else real)


class System(types.ModuleType):
    """The class of `sys`."""

    platform = _seen(sys.platform, "win32")


class OperatingSystem(types.ModuleType):
    """The class of `os`."""

    name = _seen(os.name, "nt")


def _held_open(path):
    """Whether this process has a file open."""
    _inside[0] = True
    try:
        real = os.path.realpath(path)
        for number in _list("/proc/self/fd"):
            try:
                if _read(f"/proc/self/fd/{number}") == real:
                    return True
            except OSError:
                continue
        return False
    finally:
        _inside[0] = False


def _watch(event, values):
    if _inside[0]:
        return
    if event in ("open", "os.listdir", "os.scandir", "os.mkdir"):
        _check_path(event, values)
    elif event == "socket.__new__" and values[1] in FAMILIES:
        raise OSError(97, "Address family not supported by protocol")
    elif event in ("os.remove", "os.rename"):
        for path in values[:1 if event == "os.remove" else 2]:
            if isinstance(path, str) and _held_open(path):
                raise PermissionError(13, "The process cannot access the file because it is being used", path)


def _check_path(event, values):
    path = values[0]
    path = os.fsdecode(path) if isinstance(path, (str, bytes, os.PathLike)) else ""
    if DEVICES.match(path):
        raise FileNotFoundError(2, "No such file or directory", path)
    makes = event == "os.mkdir" or (event == "open" and isinstance(values[2], int) and values[2] & ~READ_ONLY)
    if makes and path != os.devnull and any(WRONG_NAME.search(part) for part in set(path.split("/")) - {".", ".."}):
        raise OSError(22, "Invalid argument", path)
    if event == "open" and values[1] is None and values[2] & os.O_TMPFILE != os.O_TMPFILE and _is_directory(path):
        raise PermissionError(13, "Permission denied", path)      # as when its entry is to be on disk


def _is_directory(path):
    _inside[0] = True
    try:
        return os.path.isdir(path)
    finally:
        _inside[0] = False


with contextlib.suppress(ImportError):            # it has a module of its own for Windows
    import serial  # noqa: F401

for _module, _names in GONE.items():
    for _name in [one for one in vars(_module) if re.fullmatch(_names, one)]:
        delattr(_module, _name)
for _name in MODULES:
    sys.modules.pop(_name, None)
shutil._use_fd_functions = False                  # Windows lacks them
sys.meta_path.insert(0, Blocked())
importlib._bootstrap._new_module = types.ModuleType      # it makes modules of the class of sys
sys.__class__, os.__class__ = System, OperatingSystem
sys.addaudithook(_watch)
warnings.filterwarnings("ignore", category=EncodingWarning)
warnings.filterwarnings("error", category=EncodingWarning, module=r"truearc")

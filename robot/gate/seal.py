"""A model file that carries the hash of itself, so that a damaged or altered one is refused.

The hash stands in the file's metadata; it is that of the file with UNSEALED in its own place.
"""

import hashlib

KEY_SEAL = "truearc.file_sha256"
UNSEALED = "seal" * 16                # as long as a SHA-256 in hex


def seal(data: bytes) -> bytes:
    """The file with its hash in the one place where UNSEALED stands; ValueError when there is not just one."""
    if data.count(UNSEALED.encode()) != 1:
        raise ValueError("no single place for the seal")
    return data.replace(UNSEALED.encode(), hashlib.sha256(data).hexdigest().encode())


def is_intact(data: bytes, stamped: str) -> bool:
    """Whether the file is, apart from the seal, the one that was sealed."""
    if len(stamped) != len(UNSEALED) or data.count(stamped.encode()) != 1:
        return False
    return hashlib.sha256(data.replace(stamped.encode(), UNSEALED.encode())).hexdigest() == stamped

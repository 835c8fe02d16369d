"""The address of a Dask scheduler: which forms are taken, and what each of them needs.

A client of Dask unpickles what its scheduler sends, which may be a program. So the other end must be one's own. tls://
proves it: the scheduler shows a certificate that those of Dask's settings vouch for. tcp:// proves nothing; it is taken
only where the user says that he trusts whoever answers (`TrustedScheduler`, --trust-scheduler).
"""

from __future__ import annotations

import re
from typing import Any, NamedTuple

from hagoromo.errors import InputError
from hagoromo.files.names import reason

ADDRESS = re.compile(r"(tcp|tls)://([\w.-]+|\[[0-9A-Fa-f:.]+(?:%\w+)?\]):(\d{1,5})/?", re.ASCII)
LARGEST_PORT = 2**16 - 1
FORMS = "tls://host:8786, or tcp://host:8786 with --trust-scheduler"
CERTIFICATES = "distributed.comm.tls.ca-file, .client.cert and .client.key"


class TrustedScheduler(str):
    """The address of a scheduler whose every answer may run code on this machine: `TrustedScheduler("tcp://host:8786")`.

    Only where nobody else can answer at that address, or read what passes.
    """

    __slots__ = ()


class SchedulerAddress(NamedTuple):
    """An address that may be connected to. text: as Dask takes it."""

    text: str
    host: str
    port: int

    @property
    def encrypted(self) -> bool:
        """Whether both ends prove by certificates who they are."""
        return self.text.startswith("tls:")

    def security(self, distributed: Any) -> Any:
        """Dask's `Security` of a client: with the certificates of Dask's settings, which tls:// needs."""
        if not self.encrypted:
            return distributed.Security(require_encryption=False)
        security = distributed.Security(require_encryption=True)
        try:
            context = security.get_connection_args("client")["ssl_context"]
        except (OSError, ValueError) as error:  # of ssl, too
            raise InputError(
                f"{self.text} needs certificates, and those of Dask's settings ({CERTIFICATES}) cannot be read: "
                f"{reason(error)}"
            ) from error
        if context is None:
            raise InputError(
                f"{self.text} needs certificates: make some and name them in Dask's settings ({CERTIFICATES}), "
                "as docs/cluster.md says"
            )
        return security


def shown(text: str) -> str:
    """The text of an address as messages repeat it: without user, password and all that may be a secret."""
    scheme, mark, rest = text.rpartition("://")
    return f"{scheme}{mark}{re.split('[?#]', rest.rpartition('@')[2])[0]}"[:80]


def scheduler_address(text: str) -> SchedulerAddress:
    """The address that may be connected to; `InputError` for another form, and for tcp:// that nobody trusts."""
    found = ADDRESS.fullmatch(text)
    if found is None or not 0 < int(found[3]) <= LARGEST_PORT:
        wrong = "holds a user or a password, which Dask does not take" if "@" in text else "is of another form"
        raise InputError(f"the address of the scheduler, {shown(text)!r}, {wrong}: give {FORMS}")
    address = SchedulerAddress(text.rstrip("/"), found[2].strip("[]"), int(found[3]))
    if not (address.encrypted or isinstance(text, TrustedScheduler)):
        raise InputError(
            f"whoever answers at {text} can run programs on this machine: give a tls:// address, whose certificate is "
            "checked, or add --trust-scheduler (in Python: hg.TrustedScheduler) where only you can answer there"
        )
    return address

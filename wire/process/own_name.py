"""Who runs this process, and where: for the record of requests. Nobody proves it; certificates do."""

import os
import pwd


def own_name() -> str:
    """`user@machine`; the user's number where it has no name."""
    try:
        user = pwd.getpwuid(os.getuid()).pw_name
    except KeyError:
        user = str(os.getuid())
    return f"{user}@{os.uname().nodename}"

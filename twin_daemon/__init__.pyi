from twin_daemon.api import (
    add as add,
)
from twin_daemon.api import (
    calibrate as calibrate,
)
from twin_daemon.api import (
    check as check,
)
from twin_daemon.api import (
    compare as compare,
)
from twin_daemon.api import (
    diagnose as diagnose,
)
from twin_daemon.api import (
    hand as hand,
)
from twin_daemon.api import (
    ladder as ladder,
)
from twin_daemon.api import (
    recording as recording,
)
from twin_daemon.api import (
    versions as versions,
)

__version__: str

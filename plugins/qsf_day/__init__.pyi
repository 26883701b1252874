from .judge import Check as Check, StateVerdict as StateVerdict
from .mistakes import Explanation as Explanation
from .options import ProtocolOptions as ProtocolOptions, VisitOptions as VisitOptions
from .protocol import Protocol as Protocol, make_protocol as make_protocol
from .record import Record as Record, Slot as Slot
from .session import Day as Day, Judged as Judged, begin as begin, decide as decide, enter as enter

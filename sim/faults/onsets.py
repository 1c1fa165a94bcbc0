"""When each fault of a flight begins and ends, by the phases as they come."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from formation.messages import Phase
from sim.faults.fault import Fault, Site
from wire.transport.memory_bus import NOTHING_DUE_NS

NOTHING_YET: Mapping[Phase, int] = MappingProxyType({})


class Onsets:
    """The onsets of some faults; `enter` starts a phase. entered: phases entered before, and when."""

    def __init__(self, faults: Sequence[Fault], entered: Mapping[Phase, int] = NOTHING_YET) -> None:
        self.faults = tuple(faults)
        self.next_due_ns = NOTHING_DUE_NS
        """When the next fault begins or ends that is known to."""
        self.first_ns: int | None = None
        """When the first of them began."""
        self.entered: dict[Phase, int] = {}
        """When each phase was first entered."""
        self._due: list[tuple[int, int, bool]] = []
        self._active: dict[int, int] = {}
        self.active: Mapping[Site, Sequence[tuple[int, Fault, int]]] = dict.fromkeys(Site, ())
        """Number, fault and onset of each that acts now, by where it acts."""
        for phase, t_ns in entered.items():
            self.enter(phase, t_ns)

    def enter(self, phase: Phase, now_ns: int) -> None:
        """The flight is in `phase`; only the first time counts."""
        if phase in self.entered:
            return
        self.entered[phase] = now_ns
        for i, fault in enumerate(self.faults):
            if Phase[fault.phase] is not phase:
                continue
            begin_ns = self.begins_ns(fault)
            self._due.append((begin_ns, i, True))
            if fault.for_s is not None:
                self._due.append((begin_ns + round(fault.for_s * 1e9), i, False))
        self._update_next_due()

    def begins_ns(self, fault: Fault) -> int:
        """When the fault begins; NOTHING_DUE_NS while its phase has not come."""
        entered_ns = self.entered.get(Phase[fault.phase])
        return NOTHING_DUE_NS if entered_ns is None else entered_ns + round(fault.after_s * 1e9)

    def pop_due(self, now_ns: int) -> list[tuple[Fault, bool]]:
        """The faults that have begun (True) or ended (False) by now, in order of time."""
        if now_ns < self.next_due_ns:
            return []
        due = [entry for entry in self._due if entry[0] <= now_ns]
        self._due = [entry for entry in self._due if entry[0] > now_ns]
        for t_ns, i, begins in due:
            if begins:
                self._active[i] = t_ns
                self.first_ns = t_ns if self.first_ns is None else self.first_ns
            else:
                self._active.pop(i, None)
        self.active = {
            site: [(i, self.faults[i], t_ns) for i, t_ns in self._active.items() if self.faults[i].site is site]
            for site in Site
        }
        self._update_next_due()
        return [(self.faults[i], begins) for _, i, begins in due]

    def _update_next_due(self) -> None:
        self._due.sort(key=lambda entry: (entry[0], entry[1]))
        self.next_due_ns = self._due[0][0] if self._due else NOTHING_DUE_NS

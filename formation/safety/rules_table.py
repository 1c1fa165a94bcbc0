"""The rules as the documentation shows them."""

from formation.messages import Phase
from formation.safety.rules import RULES, Own, Rule


def rules_markdown() -> str:
    """The policy as the documentation shows it: a row a fault."""
    head = "| name | fault | after, s | in phases | the swarm | that drone |\n|---|---|---|---|---|---|"
    rows = (
        f"| `{rule.name}` | {rule.fault} | {rule.persist_s:g} | {_phases(rule)} | {_swarm(rule)} | {rule.own} |"
        for rule in RULES
    )
    return "\n".join((head, *rows))


def _phases(rule: Rule) -> str:
    return "any" if rule.phases == frozenset(Phase) else ", ".join(p.name for p in Phase if p in rule.phases)


def _swarm(rule: Rule) -> str:
    if rule.swarm is not None:
        return f"{rule.swarm}"
    return "warning only" if rule.own is Own.NOTHING else "-"

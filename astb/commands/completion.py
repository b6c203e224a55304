"""Completion in the shell: names of plans, rigs, specimens and effects, and the script for the shell."""

from collections.abc import Callable, Iterable
from typing import Final

import click
from click.shell_completion import CompletionItem, get_completion_class

from astb.rig_file import rigs

SHELLS: Final = ("bash", "zsh", "fish")
Completer = Callable[[click.Context, click.Parameter, str], "list[CompletionItem]"]


def complete_from(names: Callable[[], Iterable[str]], *, files: bool = False) -> Completer:
    """Return a completer that offers the ``names`` that begin with the user's text; none if ``names()`` fails.

    With ``files`` the shell also offers files: bash if no name fits, other shells in addition to the names.
    """

    def offer(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        del ctx, param
        try:
            known = [CompletionItem(name) for name in names() if name.startswith(incomplete)]
        except (Exception, SystemExit):  # a shell shows whatever is printed in the middle of the user's line
            known = []
        return [CompletionItem(incomplete, type="file"), *known] if files else known

    return offer


def _plan_names() -> Iterable[str]:
    from test_plans.discovery import plans

    return plans()


def _specimen_names() -> Iterable[str]:
    from test_plans.specimen import packaged

    return packaged()


def _rig_names() -> Iterable[str]:
    return rigs()


def _effect_names() -> Iterable[str]:
    from bench_sim.model.effects import CATALOGUE

    for one in CATALOGUE.values():
        yield from (f"{one.name}.{place}=" for place in one.places) if one.places else (f"{one.name}=",)


complete_plans: Final = complete_from(_plan_names, files=True)
complete_specimens: Final = complete_from(_specimen_names, files=True)
complete_rigs: Final = complete_from(_rig_names, files=True)
complete_effects: Final = complete_from(_effect_names)


def complete_settings(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Offer ``NAME=`` for the parameters of the plans on the command line, or ``NAME=CHOICE`` for each of their
    choices.
    """
    from test_plans.discovery import plans

    known = plans()
    named = (
        *(ctx.params.get("plans") or ()),
        *ctx.args,
    )  # click has not read the rest, because --set has no value yet
    chosen = [known[name] for name in named if name in known]
    parameters = [one for plan in chosen for one in plan.parameters]
    texts = [f"{one.name}={choice}" for one in parameters for choice in (one.choices or ("",))]
    return complete_from(lambda: dict.fromkeys(texts))(ctx, param, incomplete)


@click.command("completion")
@click.argument("shell", type=click.Choice(SHELLS))
@click.pass_context
def completion_command(context: click.Context, shell: str) -> None:
    """Print the completion script for bash, zsh or fish.

    For bash: astb completion bash > ~/.local/share/bash-completion/completions/astb
    """
    kind = get_completion_class(shell)
    assert kind is not None, shell
    click.echo(kind(context.find_root().command, {}, "astb", "_ASTB_COMPLETE").source())

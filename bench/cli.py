"""The command `evs-bench`: finds the command, runs it, and turns every way to fail into one line and an exit code.

Exit codes: 0 done; 1 bad input or usage; 2 a device failed; 70 a bug of ours; 130 stopped by the operator.
Results go to stdout, everything else to stderr.
"""

from __future__ import annotations

import importlib
import os
import select
import sys
from typing import TYPE_CHECKING, Any, Final

import click

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["EXIT_BUG", "EXIT_DEVICE", "EXIT_INPUT", "EXIT_STOPPED", "main"]

# Our matrices are small: threads of the linear algebra cost more than they bring, much more where several processes
# work side by side. It reads this when numpy is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

EXIT_INPUT: Final = 1
EXIT_DEVICE: Final = 2
EXIT_BUG: Final = 70
EXIT_STOPPED: Final = 130

#: Name of each command, what `--help` says of it, in the order of the work. The modules are imported when needed.
_COMMANDS: Final = {
    "demo": "Measure a simulated sensor and compare the result with the truth.",
    "reproduce": "Run a published simulation study, and hold it against what it says.",
    "protocols": "List the protocols that come with the bench; copy or show one.",
    "check": "Look a protocol over before it is run: limits, warnings, when it ends, what to do by hand.",
    "run": "Run a protocol on a station, and leave a run folder.",
    "watch": "Show a run in the browser while it is taken.",
    "pause": "Let a run that is being taken pause at its next point, the light dark.",
    "continue": "Let a paused run go on.",
    "abort": "End a run that is being taken at once, the light dark.",
    "resume": "Take the rest of a run that was stopped or killed.",
    "rerun": "Take a simulated run once more: the same events again.",
    "queue": "Run several protocols through the night, one after the other, with reference runs between.",
    "notify-test": "Send one of each notice that a file asks for, and say what happened.",
    "runs": "List the runs in a folder: what, when, on which sensor, how it ended.",
    "diff": "Say what differs between the settings of two runs.",
    "analyze": "Turn a run into S-curves, thresholds and background rates.",
    "characterize": "Turn runs into the numbers of a sensor: threshold, dark light, noise, bandwidth, mismatch.",
    "compare": "Fit a pixel model to a run, and show where they disagree.",
    "diagnose": "Say which effects a pixel model of a run lacks, add them, watch the error fall.",
    "report": "Make the report of a run: one HTML file, figures and tables.",
    "import": "Make a run of recordings that were taken elsewhere.",
    "events": "Say what is in a recording.",
    "challenge": "Diagnose a simulated station of which nobody is told what it is.",
    "effects": "List the physical effects that a pixel model may have; explain one.",
    "calibrate-noise": "Find the noise that gives a background rate.",
    "calibrate-biases": "Make a station's bias map of a run: thresholds, corner, dead time against offsets.",
    "photometry": "Turn meter readings, lens data or a spectrum into lux and photons on the chip.",
    "devices": "Say which instruments of a station answer, and what is plugged in.",
    "selftest": "Look at every instrument of a station: the first power-on, measured.",
}


#: Modules whose name differs from that of their command.
_MODULES: Final = {
    "calibrate-biases": "calibrate_biases",
    "calibrate-noise": "calibrate_noise",
    "continue": "continue_",
    "import": "import_",
    "notify-test": "notify_test",
}


class _LazyGroup(click.Group):
    """A group that imports a command only when it is called, so that `--help` is instant."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        del ctx
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        del ctx
        if cmd_name not in _COMMANDS:
            return None
        module = importlib.import_module(f"bench.commands.{_MODULES.get(cmd_name, cmd_name)}")
        command: click.Command = module.command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        del ctx
        with formatter.section("Commands"):
            formatter.write_dl(list(_COMMANDS.items()))


def _print_version(ctx: click.Context, _param: click.Parameter, value: bool) -> None:
    if value and not ctx.resilient_parsing:
        from bench.version import version

        click.echo(f"evs-bench {version()}")
        ctx.exit()


@click.group(cls=_LazyGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.option(
    "--version", is_flag=True, is_eager=True, expose_value=False, callback=_print_version, help="Print the version."
)
def cli() -> None:
    """Measure event-based vision sensors, on a real bench or a simulated one.

    A first look, without hardware:  evs-bench demo
    """


def main(arguments: Sequence[str] | None = None) -> None:
    """Run `evs-bench` with `arguments` (default: those of the process) and exit with its code."""
    sys.exit(run(list(sys.argv[1:] if arguments is None else arguments)))


def run(arguments: list[str]) -> int:
    """Run `evs-bench` with `arguments` and return its exit code."""
    try:
        result: Any = cli.main(arguments, prog_name="evs-bench", standalone_mode=False)
        if sys.stdout is not None:
            sys.stdout.flush()
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.ctx.get_help() if error.ctx else "", err=True)
        return EXIT_INPUT
    except click.ClickException as error:
        return _fail(EXIT_INPUT, _usage(error))
    except (KeyboardInterrupt, click.Abort) as error:
        # Click makes an Abort of a KeyboardInterrupt; a run that was stopped says in it what was kept.
        interrupt = error.__cause__ if isinstance(error, click.Abort) else error
        return _fail(EXIT_STOPPED, str(interrupt or "") or "stopped")
    except (BrokenPipeError, SystemExit) as error:
        return _reader_gone() if _stdout_is_closed() else _report(error.__context__ or error)  # click hides it
    except Exception as error:  # noqa: BLE001 - the last resort: every failure becomes one line and a code
        return _report(error)
    return result if isinstance(result, int) else 0


def _stdout_is_closed() -> bool:
    """Return whether the reader of our output went away (`evs-bench events FILE | head`)."""
    if sys.stdout is None or not hasattr(select, "poll"):
        return True
    poll = select.poll()
    poll.register(sys.stdout.fileno(), select.POLLOUT)
    return any(state & (select.POLLERR | select.POLLHUP) for _, state in poll.poll(0))


def _reader_gone() -> int:
    """Leave quietly: there is nothing to tell, and nobody to tell it to."""
    if sys.stdout is not None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def _usage(error: click.ClickException) -> str:
    context = getattr(error, "ctx", None)
    hint = f" (see {context.command_path} --help)" if isinstance(error, click.UsageError) and context else ""
    return " ".join(error.format_message().split()) + hint


def _report(error: BaseException) -> int:
    from bench.compute.executor import ItemFailed
    from drivers.errors import DeviceError
    from protocols.errors import InputError

    if isinstance(error, ItemFailed):
        error = error.error
    if isinstance(error, InputError):
        return _fail(EXIT_INPUT, *[str(problem) for problem in error.problems])
    if isinstance(error, DeviceError):
        return _fail(EXIT_DEVICE, *getattr(error, "lines", (str(error),)))
    if isinstance(error, OSError) and error.errno is not None:
        # The machine said no: no such file, no room, no right. It names what, and why.
        return _fail(EXIT_INPUT, f"{error.filename}: {error.strerror}" if error.filename else str(error.strerror))
    if isinstance(error, MemoryError):
        return _fail(EXIT_INPUT, "there is not enough memory for this")
    from bench.logs import record_bug

    what = f"{type(error).__name__}: {error}".splitlines()[0]
    return _fail(EXIT_BUG, f"this is a bug of evs-bench, please report it: {what} (traceback in {record_bug(error)})")


def _fail(code: int, *lines: str) -> int:
    for line in lines:
        click.echo(f"evs-bench: {line}", err=True)
    return code

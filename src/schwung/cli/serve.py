"""`schwung serve`: the service beside the bus."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from schwung.cli.options import (
    Bitrate,
    BusOption,
    CanLog,
    Channel,
    Interface,
    Json,
    bus_options,
    require_plant,
)

if TYPE_CHECKING:
    from schwung.service.values import BusEntry, DriveSeed


def serve(
    demo: Annotated[
        bool, typer.Option("--demo", help="Bring a simulated drive along, on a bus of its own.")
    ] = False,
    data: Annotated[
        Path | None, typer.Option(help="Folder for runs, recordings and the token; default: schwung-service.")
    ] = None,
    host: Annotated[
        str, typer.Option(help="Address to listen on; others than this computer need the token.")
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(min=0, max=65534, help="Port of page and API; STOP listens on the next.")
    ] = 8737,
    allow_host: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="A further name by which we are reached. Repeatable."),
    ] = None,
    poll: Annotated[
        float, typer.Option(min=0.0, metavar="S", help="Look at idle drives so often; 0: never.")
    ] = 1.0,
    plant: Annotated[str, typer.Option(help="--demo: slider-crank (MuJoCo) or two-mass.")] = "slider-crank",
    conceal: Annotated[
        str, typer.Option(metavar="NAME=VALUE,…", help="--demo: physics to hide in the plant.")
    ] = "",
    interface: Interface = None,
    channel: Channel = None,
    bitrate: Bitrate = None,
    bus: BusOption = None,
    can_log: CanLog = None,
    log_json: Annotated[
        bool, typer.Option("--log-json", help="Log to stderr what happens, one JSON object per line.")
    ] = False,
    systemd_unit: Annotated[
        bool,
        typer.Option("--systemd-unit", help="Print a systemd unit that serves with these options, and end."),
    ] = False,
    json_output: Json = False,
) -> None:
    """Serve page and API, keep every run, own the bus. Ends with Ctrl-C: what moves is stopped first.

    The start line has the address with the token in it: whoever opens it may move the machine.

    [bold]Examples[/]

      schwung serve --demo

      schwung serve -i socketcan -c can0 --data axis-lab

      schwung serve -i socketcan -c can0 --log-json --systemd-unit > /etc/systemd/system/schwung.service

      schwung serve -i pcan -c PCAN_USBBUS1 -b 1000000 --host 0.0.0.0 --allow-host lab-pc.local
    """  # fmt: skip
    from dataclasses import asdict

    from schwung.cli.console import Terminal
    from schwung.errors import InputError
    from schwung.extras import require

    require("schwung serve", "web")
    if demo:
        require_plant("schwung serve --demo", plant)
    from schwung.service.serve import Started, run
    from schwung.service.values import BusEntry, Settings

    given = interface is not None or channel is not None
    if systemd_unit and demo:
        raise InputError("--systemd-unit", "is for a bus of your own", "Leave --demo out.")
    if can_log is not None and not given:
        raise InputError("--can-log", "needs a bus of your own", "Give --interface and --channel.")
    if systemd_unit:
        from schwung.service.systemd import unit

        arguments = _arguments(host, port, allow_host, interface, channel, bitrate, bus, log_json)
        typer.echo(unit(arguments, data), nl=False)
        return
    if log_json:
        from schwung.service.logs import log_json as begin_log

        begin_log()
    terminal = Terminal(json_output)
    if demo and given:
        raise InputError("--demo", "brings its own bus", "Leave --interface and --channel out.")
    with ExitStack() as stack:
        buses: tuple[BusEntry, ...] = ()
        drives: tuple[DriveSeed, ...] = ()
        if demo:
            from schwung.cli.demo_bench import demo_bench

            entry, seed = stack.enter_context(demo_bench(plant, conceal))
            buses, drives = (entry,), (seed,)
        elif given:
            buses = (BusEntry("bus", bus_options(interface, channel, bitrate, bus, can_log)),)
        settings = Settings(
            folder=data or Path("schwung-demo" if demo else "schwung-service"), buses=buses, drives=drives, host=host,
            port=port, names=tuple(allow_host or ()), poll_s=poll, demo=demo,
        )  # fmt: skip

        def announce(started: Started) -> None:
            if json_output:
                terminal.result(asdict(started))
            else:
                terminal.say(f"Schwung serves at {started.url}; to act, open [bold]{started.login_url}[/]")
                terminal.say(
                    f"STOP also listens at {started.stop_url}; the records are in {settings.folder}. Ctrl-C ends."
                )

        run(settings, announce)


def _arguments(
    host: str,
    port: int,
    allow_host: list[str] | None,
    interface: str | None,
    channel: str | None,
    bitrate: int | None,
    bus: list[str] | None,
    log_json: bool,
) -> list[str]:
    """The options of this call as a unit repeats them."""
    words = ["--host", host, "--port", str(port)]
    for option, value in (("-i", interface), ("-c", channel), ("-b", bitrate)):
        words += [] if value is None else [option, str(value)]
    for option, values in (("--allow-host", allow_host), ("--bus", bus)):
        words += [word for value in values or () for word in (option, value)]
    return [*words, "--log-json"] if log_json else words

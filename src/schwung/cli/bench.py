"""`schwung bench`: a simulated drive in its own process, on vcan or on a loopback TCP bus."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from schwung.cli.options import Bitrate, BusOption, Channel, Interface, Json, Node, bus_options, require_plant

if TYPE_CHECKING:
    from schwung.cli.console import Terminal


def bench(
    plant: Annotated[str, typer.Option(help="two-mass or slider-crank.")] = "two-mass",
    conceal: Annotated[
        str, typer.Option(metavar="NAME=VALUE,…", help="Physics to switch on in the plant; see --list.")
    ] = "",
    seed: Annotated[int, typer.Option(help="Noise, serial number: everything random follows from it.")] = 0,
    clock: Annotated[
        str, typer.Option(help="sync: time passes with SYNC (exact, any speed); wall: real time.")
    ] = "sync",
    tcp: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT", help="Serve a loopback TCP bus (socketcand protocol); port 0: any."
        ),
    ] = None,
    modbus_tcp: Annotated[
        str | None,
        typer.Option(metavar="HOST:PORT", help="Be a Modbus drive, served there; port 0: any."),
    ] = None,
    modbus_rtu: Annotated[
        bool,
        typer.Option("--modbus-rtu", help="Be a Modbus drive on a serial line, which is made; -b paces it."),
    ] = False,
    profile: Annotated[
        str | None,
        typer.Option(
            metavar="FAMILY|FILE",
            help="Be a drive of this family: its objects, units and ways; default: our own.",
        ),
    ] = None,
    eds: Annotated[
        Path | None, typer.Option(help="Show exactly this dictionary; default: the one beside the profile.")
    ] = None,
    memory: Annotated[
        Path | None, typer.Option(help="File in which stored parameters (1010) outlive the process.")
    ] = None,
    fault: Annotated[
        list[str] | None, typer.Option(metavar="FAULT", help="A fault to make; see --list. Repeatable.")
    ] = None,
    seconds: Annotated[float | None, typer.Option(min=0.0, help="End by itself after so long.")] = None,
    listing: Annotated[
        bool, typer.Option("--list", help="List what can be concealed and which faults there are.")
    ] = False,
    interface: Interface = None,
    channel: Channel = None,
    bitrate: Bitrate = None,
    bus: BusOption = None,
    node: Node = 1,
    json_output: Json = False,
) -> None:
    """Run a simulated CiA 402 drive with a machine on its shaft until Ctrl-C.

    [bold]Examples[/]

      schwung bench --tcp 127.0.0.1:29536     (then: -i socketcand -c vcan0 --bus host=127.0.0.1 --bus port=29536)

      schwung bench -i socketcan -c vcan0 --plant slider-crank

      schwung bench --tcp 127.0.0.1:0 --conceal coulomb_friction=3,cogging --seed 7

      schwung bench --tcp 127.0.0.1:0 --profile maxon-epos4 --eds epos4.eds

      schwung bench --modbus-tcp 127.0.0.1:1502     (then: -i modbus-tcp -c 127.0.0.1:1502)

      schwung bench --modbus-rtu                    (then: -i modbus-rtu -c /dev/pts/…)
    """  # fmt: skip
    from schwung.cli.console import Terminal
    from schwung.errors import InputError

    require_plant("schwung bench", plant)
    import schwung.python_can  # noqa: F401  # first: without what only its MF4 files need
    from schwung_sim.bench import Bench

    terminal = Terminal(json_output)
    if listing:
        _list_choices(terminal)
        return
    if clock not in ("sync", "wall"):
        raise InputError("--clock", f'is "{clock}"', "Use sync or wall.")
    given = (
        tcp is not None,
        interface is not None or channel is not None,
        modbus_tcp is not None,
        modbus_rtu,
    )
    if sum(given) != 1:
        raise InputError(
            "bench", "needs one bus", "Give --tcp, --modbus-tcp, --modbus-rtu, or --interface and --channel."
        )
    if modbus_tcp is not None or modbus_rtu:
        from schwung_sim.modbus_bench import DEFAULT_FAMILY, ModbusBench

        modbus = ModbusBench(
            plant, profile=profile or DEFAULT_FAMILY, conceal=conceal, seed=seed, unit=node, bitrate=bitrate,
            faults=",".join(fault or ()), tcp=_address(modbus_tcp, "--modbus-tcp") if modbus_tcp else None,
        )  # fmt: skip
        modbus.run_forever(
            seconds, lambda line: terminal.result(modbus.told()) if json_output else typer.echo(line)
        )
        return
    bus_settings = {} if tcp else bus_options(interface, channel, bitrate, bus).resolve()
    machine_room = Bench(
        plant, conceal=conceal, seed=seed, clock="wall" if clock == "wall" else "sync", node_id=node,
        memory=memory, faults=",".join(fault or ()), eds=eds, profile=profile, tcp=_address(tcp) if tcp else None,
        interface=str(bus_settings.pop("interface", "socketcand")),
        channel=str(bus_settings.pop("channel", channel or "vcan0")), bus_options=bus_settings,
    )  # fmt: skip

    def announce(line: str) -> None:
        if json_output:
            where = {"bus": machine_room.tool_options, "node": node, "plant": plant, "clock": clock}
            terminal.result(where)
        else:
            typer.echo(line)

    machine_room.run_forever(seconds, announce=announce)


def _list_choices(terminal: Terminal) -> None:
    """What --conceal and --fault take, as the machine room describes it."""
    from schwung_sim import faults
    from schwung_sim.drives.modbus import faults as modbus_faults
    from schwung_sim.plants import concealed

    physics = {name: {"text": e.text, "keys": list(e.key_names)} for name, e in concealed.EFFECTS.items()}
    if terminal.json_output:
        kinds = {"faults": sorted(faults.KINDS), "modbus_faults": sorted(modbus_faults.KINDS)}
        terminal.result({"conceal": physics, **kinds})
        return
    typer.echo(concealed.__doc__)
    for name, effect in concealed.EFFECTS.items():
        typer.echo(f"    {name:22s} {effect.text}\n    {'':22s} keys: {', '.join(effect.key_names)}")
    typer.echo(f"\n{faults.__doc__}\nModbus. {modbus_faults.__doc__}")


def _address(text: str, option: str = "--tcp") -> tuple[str, int]:
    from schwung.errors import InputError

    host, _, port = text.rpartition(":")
    if not (host and port.isdigit() and int(port) < 65536):
        raise InputError(option, f'"{text}" is no address', f"Write for instance {option} 127.0.0.1:29536.")
    return host, int(port)

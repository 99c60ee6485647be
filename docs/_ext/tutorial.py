"""What every tutorial imports, unseen: `%%bash` as a page can show it, without colours and in one piece."""

import os
import subprocess

from IPython.core.magic import register_cell_magic

for _name in ("FORCE_COLOR", "CLICOLOR_FORCE", "CLICOLOR"):  # the kernel asks for colours
    os.environ.pop(_name, None)
os.environ["TERM"] = "dumb"


@register_cell_magic
def bash(_line: str, cell: str) -> None:
    """Run the cell, show what it says; raise CalledProcessError where a command fails."""
    command = ["bash", "-e", "-c", cell]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    print(done.stdout.rstrip())
    done.check_returncode()

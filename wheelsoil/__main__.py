"""``python -m wheelsoil``: the command line, where no script is on the path."""

from wheelsoil.cli.app import main

main()

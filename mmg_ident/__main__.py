"""``python -m mmg_ident`` is the command ``mmg``."""

from mmg_ident.commands.main import run

if __name__ == "__main__":
    run()

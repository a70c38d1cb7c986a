"""`mapfuse-robot config`: what the configuration is and may be."""

from __future__ import annotations

import sys

import typer

from tools.commands.options import ConfigFile, Json, load_config, print_json

app = typer.Typer(help="Show the configuration.", no_args_is_help=True, rich_markup_mode=None)


@app.command()
def show(config_file: ConfigFile = None, as_json: Json = False) -> None:
    """Print the effective configuration: the defaults, overlaid with FILE."""
    from ruamel.yaml import YAML

    values = load_config(config_file).model_dump()
    if as_json:
        print_json(values)
        return
    yaml = YAML()
    yaml.default_flow_style = False
    yaml.representer.add_representer(
        type(None), lambda representer, _: representer.represent_scalar("tag:yaml.org,2002:null", "null")
    )
    yaml.dump(values, sys.stdout)


@app.command()
def schema() -> None:
    """Print the JSON schema of the configuration: every key with its type, limits and meaning."""
    from tools.config import Config

    print_json(Config.model_json_schema())

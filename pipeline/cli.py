"""The `pbrnet` command."""


def main() -> None: ...

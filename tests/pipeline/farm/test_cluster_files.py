"""Files for clusters: scripts run with stand-ins for ssh and srun, the rest is well-formed."""

import ast
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from pbrnet.pipeline.params import load_params
from pbrnet.pipeline.stages.cameras import run_cameras
from tests.fixtures.paths import ROOT
from tests.fixtures.stages import write_room

CLUSTER = ROOT / "examples" / "cluster"
PARAMETERS = "image: {width: 48, height: 36}\ncameras: {views_per_room: 2}\n"
# What the scripts call, as programs: the far shells are this machine's.
STAND_INS = {
    "dask": 'exec "{python}" -m dask "$@"',
    "dvc": 'exec "{python}" -m pipeline.cli inputs',
    "ssh": 'shift 2; exec sh -c "$1"',
    "srun": 'shift; exec "$@"',
}


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("", 0))
        return int(probe.getsockname()[1])


@pytest.mark.slow
@pytest.mark.timeout(240)
@pytest.mark.parametrize("words", [["ssh.sh", "here"], ["slurm.sh"]], ids=lambda words: words[0])
def test_the_script_renders_on_its_workers(words: list[str], tmp_path: Path) -> None:
    write_room(tmp_path / "data" / "scenes" / "alpha")
    (tmp_path / "params.yaml").write_text(PARAMETERS)
    run_cameras(tmp_path / "data", load_params(tmp_path / "params.yaml"))
    programs = tmp_path / ".venv" / "bin"
    programs.mkdir(parents=True)
    for name, line in STAND_INS.items():
        program = programs / name
        program.write_text("#!/bin/sh\n" + line.format(python=sys.executable) + "\n")
        program.chmod(0o755)
    done = subprocess.run(
        ["bash", str(CLUSTER / words[0]), *words[1:]],
        cwd=tmp_path,
        env={
            **os.environ,
            "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}",
            "PYTHONPATH": str(ROOT),
            "PORT": str(free_port()),
            "SLURM_SUBMIT_DIR": str(tmp_path),
            "SLURM_CPUS_PER_TASK": "1",
        },
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "inputs: 2 made" in done.stdout
    assert len(list((tmp_path / "data" / "inputs").rglob("*.exr"))) == 2


def test_kubernetes_objects_name_each_other() -> None:
    things = list(yaml.safe_load_all((CLUSTER / "kubernetes.yaml").read_text()))
    by_name = {(thing["kind"], thing["metadata"]["name"]): thing for thing in things}
    service = by_name["Service", "pbrnet-scheduler"]
    labels = by_name["Deployment", "pbrnet-scheduler"]["spec"]["template"]["metadata"]["labels"]
    assert service["spec"]["selector"] == labels
    job = by_name["Job", "pbrnet"]["spec"]["template"]["spec"]
    assert job["containers"][0]["env"][0]["value"] == "tcp://pbrnet-scheduler:8786"
    for kind, name in (("Deployment", "pbrnet-worker"), ("Deployment", "pbrnet-scheduler")):
        volumes = by_name[kind, name]["spec"]["template"]["spec"]["volumes"]
        assert volumes == job["volumes"]
    assert ("PersistentVolumeClaim", "pbrnet") in by_name


def test_the_other_files_are_well_formed() -> None:
    ast.parse((CLUSTER / "slurm_jobqueue.py").read_text())
    docker = (CLUSTER / "Dockerfile").read_text()
    for line in docker.splitlines():
        if line.startswith("COPY "):
            for name in line.split()[1:-1]:
                assert (ROOT / name).exists(), name
    copied = {line.split()[1] for line in docker.splitlines() if line.startswith("COPY ")}
    for link in (ROOT / "pbrnet").iterdir():
        if link.is_symlink():
            assert link.readlink().parts[1] in copied, link.name

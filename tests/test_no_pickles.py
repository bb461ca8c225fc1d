"""No module loads a pickle, or runs text, but where it is said here why."""

import ast
from pathlib import Path

import swim2real

SOURCE = Path(swim2real.__file__).parent
PICKLERS = {"pickle", "cloudpickle", "dill", "joblib", "shelve", "marshal", "jsonpickle"}
OWN_PROCESSES = "processes.py"  # what a process and its child send each other through a pipe of their own
RUN_TEXT = {"eval", "exec", "compile", "__import__"}


def findings(path):
    """Places of a module that load pickles or run text."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        imported = [name.name for name in node.names] if isinstance(node, ast.Import) else []
        imported += [str(node.module)] if isinstance(node, ast.ImportFrom) else []
        if PICKLERS & {name.partition(".")[0] for name in imported} and path.name != OWN_PROCESSES:
            yield node.lineno, "imports a pickler"
        if not isinstance(node, ast.Call):
            continue
        given = {keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords}
        called = ast.unparse(node.func)
        if called in RUN_TEXT:
            yield node.lineno, called
        if given.get("allow_pickle", "False") != "False":
            yield node.lineno, "allow_pickle"
        if called in ("torch.load", "yaml.load", "yaml.unsafe_load", "SAC.load") or called.endswith("read_pickle"):
            yield node.lineno, called


def test_no_module_loads_pickles_or_runs_text():
    found = [(str(path), *finding) for path in sorted(SOURCE.rglob("*.py")) for finding in findings(path)]
    assert found == []


def test_they_would_be_found(tmp_path):
    module = tmp_path / "module.py"
    lines = [
        "import pickle", "from joblib import load", "eval(x)", "exec(x)", "np.load(p, allow_pickle=True)",
        "torch.load(p)", "torch.load(p, weights_only=False)", "yaml.load(x)", "SAC.load(p)", "pd.read_pickle(p)",
    ]  # fmt: skip
    module.write_text("\n".join([*lines, "re.compile(x)", "np.load(p)"]))
    assert [line for line, _ in findings(module)] == list(range(1, len(lines) + 1))

"""Pages in Markdown and HTML: templates of prose, which data fill; tables of scores."""

import re
from collections.abc import Iterable, Mapping, Sequence
from math import floor, inf, isnan, log10, nan
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from rich.console import Console
from rich.table import Table

from agents.evaluation.aggregates import Estimate
from agents.scoring import Evaluation
from mm_gym import Scene
from mm_gym.files import write_csv
from mm_gym.tasks import short_name

FOLDER = Path(__file__).with_name("templates")


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def percent(value: float) -> str:
    """Return a ratio in whole per cent; nothing rounds to -0."""
    return f"{round(100.0 * value)} %"


def printed(cost: float) -> str:
    """Return a cost as pages have it."""
    return f"{cost:.4f}"


def decimals(costs: Iterable[float], least: int = 3) -> int:
    """Return how many digits behind the point tell costs apart.

    They are so many at least; of scenes on which the smallest cost but 0 would hardly be seen with
    them, those that show three digits of it. A cost of a millionth of the largest counts as 0.
    """
    found = [cost for cost in costs if 0.0 < cost < inf]
    smallest = min((cost for cost in found if cost > 1e-6 * max(found)), default=1.0)
    return least if smallest >= 10.0 ** (1 - least) else 2 - floor(log10(smallest))


def cost_range(least: float, most: float) -> str:
    """Return a range of costs as pages have it."""
    return f"{printed(least)} to {printed(most)}"


def span(found: Estimate, digits: int = 4) -> str:
    """Return a value as pages have it, with its interval if it has one."""
    value = f"{found.value:.{digits}f}"
    ends = f" [{found.low:.{digits}f}, {found.high:.{digits}f}]"
    return value if isnan(found.low) else value + ends


def not_scored_cells(not_scored: Mapping[str, str]) -> list[str]:
    """Return the cell of each controller that is not scored, in one line with the reason."""
    return [
        f"{name}: not scored: {'; '.join(reason.splitlines())}"
        for name, reason in not_scored.items()
    ]


TEMPLATES = Environment(
    loader=FileSystemLoader(FOLDER),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    autoescape=False,  # noqa: S701 - it is Markdown
)
TEMPLATES.globals |= {"table": markdown, "percent": percent, "short_name": short_name}
TEMPLATES.globals |= {"printed": printed, "cost_range": cost_range, "span": span}


def render(name: str, **data: object) -> str:
    """Return a page: the template of a name with data, and one empty line between paragraphs."""
    text = TEMPLATES.get_template(f"{name}.md.jinja").render(data)
    return re.sub(r"\n{3,}", "\n\n", text).strip("\n") + "\n"


WEB = TEMPLATES.overlay(autoescape=True)  # the same for HTML, where a name may hold any character


def web_page(name: str, **data: object) -> str:
    """Return a page in HTML: the template of a name with data."""
    return WEB.get_template(f"{name}.html.jinja").render(data)


def write_rows(path: Path, rows: Iterable[Mapping[str, object]]) -> None:
    """Write rows as CSV under the names of the first; no file without rows, NaN for what lacks."""
    found = list(rows)
    if found:
        names = list(found[0])
        write_csv(path, names, [[row.get(name, nan) for row in found] for name in names])  # pyright: ignore[reportArgumentType]


def print_table(
    title: str, header: Sequence[str], rows: Iterable[Sequence[str]], words: Sequence[str] = ()
) -> None:
    """Print a table; the first column and those named as words are set to the left."""
    table = Table(title=title)
    table.add_column(header[0])
    for heading in header[1:]:
        justify = "left" if heading in words else "right"
        table.add_column(heading, justify=justify, no_wrap=True)
    for row in rows:
        table.add_row(*row)
    Console().print(table)


def write_scores(results: Sequence[Evaluation], path: Path) -> None:
    """Write a row per controller; ratios are of costs over the first one's, NaN where that is 0."""
    reference = results[0].cost
    write_rows(
        path,
        (
            {
                "controller": result.name,
                "reads": result.reads,
                "cost [-]": result.cost,
                "ratio to reference [-]": result.cost / reference if reference else nan,
                "rms of x1 / scale [-]": result.rms,
                "mean return [-]": result.returns.mean(),
                "mean energy injected [J]": "" if energy is None else energy,
            }
            for result, energy in ((one, one.mean_injected) for one in results)
        ),
    )


def write_episodes(results: Sequence[Evaluation], path: Path) -> None:
    """Write a row per episode: its frequency, or else its number, and each controller's figures."""
    frequency = results[0].frequency
    columns: dict[str, Iterable[float]] = {"episode": range(results[0].returns.size)}
    if frequency is not None:
        columns = {"frequency [rad/s]": frequency}
    columns |= {f"cost of {one.name} [-]": one.episode_costs for one in results}
    columns |= {f"rms of x1 / scale of {one.name} [-]": one.episode_rms for one in results}
    write_csv(path, list(columns), list(columns.values()))  # pyright: ignore[reportArgumentType]


def print_ranking(
    results: Sequence[Evaluation], scene: Scene, not_scored: Mapping[str, str]
) -> None:
    """Print the controllers by their cost, the least first, and why others have none."""
    count, reference = results[0].returns.size, results[0]
    digits = decimals(one.cost for one in results)
    small = decimals(one.rms for one in results)
    rows = [
        (
            result.name,
            result.reads,
            f"{result.cost:.{digits}f}",
            f"{result.cost / reference.cost:.2f}" if reference.cost else "-",
            f"{result.rms:.{small}f}",
            f"{result.returns.mean():.2f}",
        )
        for result in sorted(results, key=lambda result: result.cost)
    ]
    print_table(
        f"cost: root of the mean of -reward per step, {count} held-out episodes",
        ("controller", "reads", "cost", "ratio", "rms x1", "return"),
        [*rows, *((text,) for text in not_scored_cells(not_scored))],
        words=("reads",),
    )
    Console().print(
        f"ratio: cost / cost of {reference.name}",
        f"rms x1: over {scene.objective.displacement_scale * 1e3:g} mm",
        "return: mean over the episodes",
        sep="\n",
        highlight=False,
    )

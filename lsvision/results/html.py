"""Environment of the jinja2 templates of all HTML: pages and views in notebooks."""

from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jinja2 import Environment


@cache
def build_html_environment(package: str = "lsvision.results") -> "Environment":
    """Return an environment with the templates of a package and those of `lsvision.results`.

    Templates are in the package's folder ``templates``. Pages extend ``base.html.j2`` of
    `lsvision.results`. The values of a template are escaped; an undefined name is an error.

    Examples
    --------
    >>> template = build_html_environment().from_string("<p>{{ text }}</p>")
    >>> template.render(text="x < 2 mm")
    '<p>x &lt; 2 mm</p>'
    """
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    packages = dict.fromkeys([package, "lsvision.results"])
    return Environment(
        loader=ChoiceLoader([PackageLoader(name) for name in packages]),
        autoescape=True,
        undefined=StrictUndefined,
        keep_trailing_newline=True,
    )

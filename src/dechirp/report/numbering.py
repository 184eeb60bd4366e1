r"""Numbers of figures, tables and references in a page, given as LaTeX gives them.

\label{figure:map}           where it stands: Figure 7
\ref{figure:map}             the same words, with a link
\cite{stove,winkler}         [1, 4], numbered as they are first cited
\bibliography                the list of what was cited
"""

import re
from collections.abc import Mapping

from markupsafe import escape

_LABEL = re.compile(r"\\label\{(\w+):(\w+)\}")
_REFERENCE = re.compile(r"\\ref\{(\w+):(\w+)\}")
_CITE = re.compile(r"\\cite\{([\w,-]+)\}")
_BIBLIOGRAPHY = r"\bibliography"


def numbered(text: str, references: Mapping[str, str]) -> str:
    """Replace labels, what refers to them, citations and the place of their list.

    Raises
    ------
    KeyError
        If the page refers to or cites what there is not.
    """
    words: dict[tuple[str, str], str] = {}
    counts: dict[str, int] = {}
    for kind, name in _LABEL.findall(text):
        counts[kind] = counts.get(kind, 0) + 1
        words[kind, name] = f"{kind.capitalize()} {counts[kind]}"
    cited = list(dict.fromkeys(key for keys in _CITE.findall(text) for key in str(keys).split(",")))

    def label(found: re.Match[str]) -> str:
        return f'<b id="{found[1]}-{found[2]}">{words[found[1], found[2]]}</b>'

    def link(found: re.Match[str]) -> str:
        return f'<a href="#{found[1]}-{found[2]}">{words[found[1], found[2]]}</a>'

    def cite(found: re.Match[str]) -> str:
        keys = sorted(found[1].split(","), key=cited.index)
        links = (f'<a href="#ref-{key}">{cited.index(key) + 1}</a>' for key in keys)
        return f"[{', '.join(links)}]"

    items = (
        f'<li id="ref-{key}">'
        + re.sub(r"(?<=\d)-(?=\d)", "\N{EN DASH}", str(escape(references[key])))
        + "</li>"
        for key in cited
    )
    text = _CITE.sub(cite, _REFERENCE.sub(link, _LABEL.sub(label, text)))
    return text.replace(_BIBLIOGRAPHY, f'<ol class="references">{"".join(items)}</ol>')

"""Cuts the pictures of `sonoloop render --gallery DIR` to docs/atlas and rewrites the part of README.md below its marker.

    python3 docs/atlas/make.py DIR          needs Pillow
"""

import pathlib
import re
import sys

from PIL import Image

HERE = pathlib.Path(__file__).parent
MARKER = "<!-- below: written by make.py -->\n"
ARRAY_PX = (128, 0, 512, 480)  # the columns that the array images
MAX_BYTES = 40_000
FIGURE = re.compile(r'<img src="(\w+)\.png" alt="([^"]*)"')

source = pathlib.Path(sys.argv[1])
page = (source / "index.html").read_text(encoding="utf-8")

for old in HERE.glob("*.jpg"):
    old.unlink()
lines = []
for section in page.split("<h2>")[1:]:
    title, rest = section.split("</h2>", 1)
    note = re.search(r"<p>(.*?)</p>", rest).group(1)
    figures = FIGURE.findall(rest)
    columns = 4 if len(figures) % 4 == 0 else 3
    lines += [f"## {title}", "", note, ""]
    for start in range(0, len(figures), columns):
        lines.append("<table><tr>")
        for name, caption in figures[start : start + columns]:
            picture = Image.open(source / f"{name}.png").crop(ARRAY_PX)
            file = HERE / f"{name}.jpg"
            for quality in range(75, 0, -5):
                picture.save(file, quality=quality, optimize=True)
                if file.stat().st_size <= MAX_BYTES:
                    break
            image = f'<img src="{name}.jpg" alt="{caption}">'
            lines.append(f'<td width="{100 // columns}%">{image}<br>{caption}</td>')
        lines += ["</tr></table>", ""]

readme = HERE / "README.md"
head = readme.read_text(encoding="utf-8").split(MARKER)[0]
readme.write_text(head + MARKER + "\n" + "\n".join(lines).rstrip() + "\n", encoding="utf-8")

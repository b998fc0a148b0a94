"""Checks the pages of docs/api: one for each function of the headers, whose synopsis is the header's and whose example
compiles and runs.

The examples become functions of one program. Each is given a device, and a scene of a bowl that was committed.
"""

import re

FUNCTION = re.compile(r"^FT_API [^;]*?\b(ft\w+)\([^;]*\);", re.MULTILINE)
BLOCK = re.compile(r"^```c\n(.*?)^```$", re.MULTILINE | re.DOTALL)

PROGRAM = """\
#include <fieldtrace/fieldtrace_embree.h>
#include <stdio.h>

enum {{ SIDE = 24, POSITIONS = (SIDE + 1) * (SIDE + 1), TRIANGLES = 2 * SIDE * SIDE }};
static float positions[POSITIONS][3];
static uint32_t triangles[TRIANGLES][3];

static void count_error(void* user, FTError code, const char* message) {{
  (void)code, (void)message;
  ++*(int*)user;
}}

static void note(void* user, const char* message) {{
  (void)user;
  fprintf(stderr, "%s\\n", message);
}}

static int cancel(void* user, double share) {{
  (void)user, (void)share;
  return 0;
}}

{functions}
typedef int (*Example)(FTDevice, FTScene, uint32_t, uint32_t);
static const struct {{ const char* name; Example run; }} examples[] = {{
{table}
}};

int main(void) {{
  size_t k;
  int i, j, failed = 0;
  for (i = 0; i <= SIDE; ++i) {{
    for (j = 0; j <= SIDE; ++j) {{
      float* const p = positions[i * (SIDE + 1) + j];
      p[0] = 2.0f * (float)i / SIDE - 1.0f, p[2] = 2.0f * (float)j / SIDE - 1.0f, p[1] = p[0] * p[0] + p[2] * p[2];
    }}
  }}
  for (i = 0; i < SIDE * SIDE; ++i) {{
    const uint32_t a = (uint32_t)(i / SIDE * (SIDE + 1) + i % SIDE), b = a + SIDE + 1;
    triangles[2 * i][0] = a, triangles[2 * i][1] = a + 1, triangles[2 * i][2] = b;
    triangles[2 * i + 1][0] = b, triangles[2 * i + 1][1] = a + 1, triangles[2 * i + 1][2] = b + 1;
  }}
  for (k = 0; k < sizeof examples / sizeof *examples; ++k) {{
    FTDevice device = NULL;
    FTScene scene = NULL;
    uint32_t mesh = 0, instance = 0;
    if (ftNewDevice(2, &device) || ftNewScene(device, &scene) || ftSetSceneInt(scene, "directions", 32) ||
        ftSetSceneInt(scene, "plane", 64) ||
        ftAddMesh(scene, positions[0], 0, POSITIONS, triangles[0], 0, TRIANGLES, &mesh) ||
        ftAddInstance(scene, mesh, NULL, &instance) || ftCommitScene(scene))
      return 2;
    if (examples[k].run(device, scene, mesh, instance) != 0) {{
      const char* message = "";
      ftGetDeviceError(device, &message);
      printf("%s: its example fails: %s\\n", examples[k].name, message);
      failed = 1;
    }}
    if (ftReleaseScene(scene) || ftReleaseDevice(device)) return 2;
  }}
  return failed;
}}
"""

WRAPPED = """\
static int example_{name}(FTDevice device, FTScene scene, uint32_t mesh, uint32_t instance) {{
  (void)device, (void)scene, (void)mesh, (void)instance;
  {{
{example}  }}
  return 0;
}}
"""


def one_line(declaration):
    return " ".join(declaration.replace("FT_API ", "").split())


def faults_and_program(headers, pages):
    """What is wrong with the pages (a folder) of the headers' functions, and a C program of all examples."""
    text = "".join(header.read_text() for header in headers)
    declared = {m.group(1): one_line(m.group(0)) for m in FUNCTION.finditer(text)}
    faults, functions, names = [], [], []
    there = {page.stem: page for page in sorted(pages.glob("ft*.md"))}
    faults += [f"{name} has no page {pages.name}/{name}.md" for name in declared if name not in there]
    index = (pages / "README.md").read_text()
    for name, page in there.items():
        blocks = BLOCK.findall(page.read_text())
        if name not in declared:
            faults.append(f"{page.name}: no header has a function {name}")
        elif len(blocks) != 2:
            faults.append(f"{page.name}: holds {len(blocks)} blocks of C, not a synopsis and an example")
        elif one_line(blocks[0]) != declared[name]:
            faults.append(f"{page.name}: the synopsis is not the header's: {declared[name]}")
        elif f"{name}(" not in blocks[1]:
            faults.append(f"{page.name}: the example does not call {name}")
        else:
            names.append(name)
            functions.append(WRAPPED.format(name=name, example=blocks[1]))
        if f"({name}.md)" not in index:
            faults.append(f"README.md: does not list {name}.md")
    table = "\n".join(f'    {{"{name}", example_{name}}},' for name in names)
    return faults, PROGRAM.format(functions="\n".join(functions), table=table)

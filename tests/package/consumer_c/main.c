/* A program in C99 that sees nothing but the installed package. */
#include <fieldtrace/fieldtrace.h>
#include <stdio.h>
#include <stdlib.h>

enum { SIDE = 24, POSITIONS = (SIDE + 1) * (SIDE + 1), TRIANGLES = 2 * SIDE * SIDE };

static float positions[POSITIONS][3];
static uint32_t triangles[TRIANGLES][3];

static void check(FTError code, FTDevice device) {
  const char* message = "";
  if (code == FT_ERROR_NONE) return;
  ftGetDeviceError(device, &message);
  fprintf(stderr, "error %d: %s\n", (int)code, message);
  exit(1);
}

/* A bowl y = x^2 + z^2. */
static void make_bowl(void) {
  for (int i = 0; i <= SIDE; ++i) {
    for (int j = 0; j <= SIDE; ++j) {
      float* p = positions[i * (SIDE + 1) + j];
      p[0] = 2.0f * (float)i / SIDE - 1.0f;
      p[2] = 2.0f * (float)j / SIDE - 1.0f;
      p[1] = p[0] * p[0] + p[2] * p[2];
    }
  }
  for (int i = 0; i < SIDE; ++i) {
    for (int j = 0; j < SIDE; ++j) {
      const uint32_t a = (uint32_t)(i * (SIDE + 1) + j), b = a + SIDE + 1;
      uint32_t(*t)[3] = &triangles[2 * (i * SIDE + j)];
      t[0][0] = a, t[0][1] = a + 1, t[0][2] = b;
      t[1][0] = b, t[1][1] = a + 1, t[1][2] = b + 1;
    }
  }
}

int main(int argc, char** argv) {
  const float origins[3][3] = {{0, 5, 0}, {0, 5, 0}, {3, 5, 0}};
  const float directions[3][3] = {{0, -1, 0}, {0, 1, 0}, {0, -1, 0}};
  uint8_t blocked[3], status[3];
  float t[3];
  uint32_t mesh = FT_NO_MESH, instance = FT_NO_INSTANCE;
  int64_t fields = 0;
  FTDevice device = NULL;
  FTScene scene = NULL;
  make_bowl();
  check(ftNewDevice(2, &device), NULL);
  check(ftNewScene(device, &scene), device);
  check(ftSetSceneInt(scene, "directions", 32), device);
  check(ftSetSceneInt(scene, "plane", 64), device);
  check(ftAddMesh(scene, positions[0], 0, POSITIONS, triangles[0], 0, TRIANGLES, &mesh), device);
  check(ftAddInstance(scene, mesh, NULL, &instance), device);
  check(ftCommitScene(scene), device);
  check(ftOccluded(scene, origins[0], 0, directions[0], 0, NULL, 0, NULL, 0, 3, blocked, 0), device);
  check(ftNearest(scene, 0.05f, origins[0], 0, directions[0], 0, NULL, 0, NULL, 0, 3, status, 0, t, 0, NULL, 0, NULL, 0,
                  NULL, 0),
        device);
  if (blocked[0] != FT_BLOCKED || blocked[1] != FT_CLEAR || blocked[2] != FT_CLEAR) return 2;
  if (status[0] == FT_MISS || status[1] == FT_HIT || status[2] == FT_HIT) return 3;
  check(ftGetSceneInt(scene, "fields", &fields), device);
  if (fields != 1) return 4;
  if (argc > 1) { /* opens the library's module */
    check(ftSaveField(scene, mesh, argv[1]), device);
    check(ftLoadField(scene, mesh, argv[1]), device);
  }
  if (ftSetSceneInt(scene, "nonsense", 1) != FT_ERROR_INVALID_ARGUMENT) return 5;
  check(ftReleaseScene(scene), device);
  check(ftReleaseDevice(device), NULL);
  puts("consumer: all is well");
  return 0;
}

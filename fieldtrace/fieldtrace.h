/* Fieldtrace as a library: visibility, nearest hits and pictures answered by displacement fields. C99.
 *
 * Objects are handles. A handle is created with one reference; ftRetain* adds one and ftRelease* takes one away. The
 * last release frees the object, after calls that are using it on other threads have returned. A handle that was freed,
 * or that never was one, is an error, not a crash.
 *
 * Every function but the getters of plain values returns an FTError and lets no exception out. Nothing is written to
 * results unless it returns FT_ERROR_NONE (or, for long work, FT_ERROR_CANCELLED). ftGetDeviceError() has the message.
 *
 * Buffers are a pointer, the bytes from one element to the next, and a count for all of them. Stride 0: the elements
 * lie one behind another. Pointers and strides are multiples of 4 where elements consist of 4-byte numbers. Results may
 * not overlap one another or what is read. Buffers are read and written in place, and not kept.
 *
 * Space: world, of a right-handed frame in any unit; transforms are the columns x, y, z and translation of an affine
 * map from object to world. t is in multiples of the direction, which need not be unit.
 *
 * Threads: any function may be called from any thread. Queries run beside one another and beside ftBakeFields();
 * ftCommitScene() and other changes wait for them. A callback may call nothing but ftGetDeviceError(). */
#ifndef FIELDTRACE_H
#define FIELDTRACE_H

#include <stddef.h>
#include <stdint.h>

#define FT_VERSION_MAJOR 0
#define FT_VERSION_MINOR 1
#define FT_VERSION_PATCH 0

#if defined(__GNUC__)
#define FT_API __attribute__((visibility("default")))
#else
#define FT_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

typedef struct FTDeviceTag* FTDevice;
typedef struct FTSceneTag* FTScene;

/* Numbers of errors and answers never change their meaning. */
typedef enum FTError {
  FT_ERROR_NONE = 0,
  FT_ERROR_INVALID_ARGUMENT = 1,  /* null, freed or foreign handles; bad numbers, names and buffers */
  FT_ERROR_INVALID_OPERATION = 2, /* wrong order: a query before the first commit, or after one that failed, say */
  FT_ERROR_INPUT = 3,             /* a file that is missing, damaged or does not fit; a scene that cannot be rendered */
  FT_ERROR_OUT_OF_MEMORY = 4,
  FT_ERROR_CANCELLED = 5, /* the progress callback returned 0 */
  FT_ERROR_UNKNOWN = 6
} FTError;

typedef enum FTOcclusion { FT_CLEAR = 0, FT_BLOCKED = 1, FT_UNDECIDED_OCCLUSION = 2 } FTOcclusion;
typedef enum FTHit { FT_MISS = 0, FT_HIT = 1, FT_UNDECIDED_HIT = 2 } FTHit;
typedef enum FTLightShape { FT_LIGHT_SPHERE = 0, FT_LIGHT_DISK = 1, FT_LIGHT_RECTANGLE = 2 } FTLightShape;

#define FT_NO_INSTANCE 0xffffffffu
#define FT_NO_MESH 0xffffffffu

/* `message` is valid during the call. Called on the thread that made the error. */
typedef void (*FTErrorCallback)(void* user, FTError code, const char* message);
/* `share` of the work done, in [0, 1]. Returns 0 to cancel. From one thread at a time, not always the caller's. */
typedef int (*FTProgressCallback)(void* user, double share);

/* What a scene file says and is rendered otherwise, or what a call had to leave out: text, with file and line where it
 * has them, that is valid during the call. From one thread at a time, not always the caller's. */
typedef void (*FTWarningCallback)(void* user, const char* message);

/* ---- Devices: threads, errors, callbacks ---- */

/* 10000 major + 100 minor + patch of the library that runs. */
FT_API uint32_t ftGetVersion(void);
/* `threads` that work on each call, 0: all of the machine. */
FT_API FTError ftNewDevice(uint32_t threads, FTDevice* device);
FT_API FTError ftRetainDevice(FTDevice device);
FT_API FTError ftReleaseDevice(FTDevice device);
/* The calling thread's last error on this device, or, with a null device, or a freed one that has none left, its last
 * error that belongs to no device; forgets it. `message`, if not null, receives text that is valid until the thread's
 * next such call. */
FT_API FTError ftGetDeviceError(FTDevice device, const char** message);
FT_API FTError ftSetDeviceErrorCallback(FTDevice device, FTErrorCallback callback, void* user);
/* For ftBakeFields() and ftRender*(). */
FT_API FTError ftSetDeviceProgressCallback(FTDevice device, FTProgressCallback callback, void* user);

/* For ftLoadScene() and ftRender*(): without it their warnings are lost. */
FT_API FTError ftSetDeviceWarningCallback(FTDevice device, FTWarningCallback callback, void* user);

/* ---- Scenes ---- */

FT_API FTError ftNewScene(FTDevice device, FTScene* scene);
/* A scene file in the subset of Mitsuba's format that `fieldtrace render` reads; committed. Its world is re-centred
 * (ftGetSceneOrigin()). */
FT_API FTError ftLoadScene(FTDevice device, const char* path, FTScene* scene);
FT_API FTError ftRetainScene(FTScene scene);
FT_API FTError ftReleaseScene(FTScene scene);

/* A mesh of float[3] positions and uint32_t[3] triangles, both copied; before the first commit only. `mesh`, if not
 * null, receives its number: 0, 1, ... */
FT_API FTError ftAddMesh(FTScene scene, const float* positions, size_t position_stride, size_t position_count,
                         const uint32_t* triangles, size_t triangle_stride, size_t triangle_count, uint32_t* mesh);
/* Places a mesh; before the first commit only. `transform`: 12 floats, the columns x, y, z and translation; invertible.
 * Null: the identity. */
FT_API FTError ftAddInstance(FTScene scene, uint32_t mesh, const float* transform, uint32_t* instance);
/* Takes effect with the next commit. Fields are kept. */
FT_API FTError ftSetInstanceTransform(FTScene scene, uint32_t instance, const float* transform);
/* For ftRender(), from the next call on, without a commit: two-sided diffuse reflectance, and radiance sent on the side
 * of the geometric normal; RGB. */
FT_API FTError ftSetInstanceReflectance(FTScene scene, uint32_t instance, const float* rgb);
FT_API FTError ftSetInstanceRadiance(FTScene scene, uint32_t instance, const float* rgb);
/* For ftRender(), likewise: radiance from everywhere around. */
FT_API FTError ftSetSceneSky(FTScene scene, const float* rgb);
/* For ftRender(), likewise: a pinhole that looks from `from` to `to`; `up` points up in the picture; degrees,
 * pixels. */
FT_API FTError ftSetSceneCamera(FTScene scene, const float* from, const float* to, const float* up,
                                float horizontal_degrees, uint32_t width, uint32_t height);

/* Settings by name; later versions add names. Integers: "spp" (camera samples a pixel, 0: the scene file's), "seed",
 * "directions" and "plane" (resolution of fields: 32 64 128 256, and 64 128 256 512; before the first commit),
 * "field_memory" (bytes of all fields; 0: half of the machine's; likewise), "max_depth" (of paths), "montecarlo" (1:
 * ftRender() without fields). Floats: "tolerance" ([0, 1]; 0: fields answer nothing, 1: every cell answers; takes
 * effect with the next commit). */
FT_API FTError ftSetSceneInt(FTScene scene, const char* name, int64_t value);
FT_API FTError ftSetSceneFloat(FTScene scene, const char* name, double value);

/* Makes the scene as it was set answer queries. Builds what exact rays need anew; keeps all fields. If it fails,
 * nothing answers until a commit succeeds. */
FT_API FTError ftCommitScene(FTScene scene);
/* `origin`: 3 doubles; the file's coordinates are those used here plus the origin. */
FT_API FTError ftGetSceneOrigin(FTScene scene, double* origin);

/* ---- Fields: baked where queries ask often enough, or whole ahead of them ---- */

/* Bakes all fields of the scene whole. Cancelled, or out of memory, what is baked is kept. */
FT_API FTError ftBakeFields(FTScene scene);
/* What is baked of a mesh's field, as a .vdb file; meshes without a field (small or flat ones) are an error. */
FT_API FTError ftSaveField(FTScene scene, uint32_t mesh, const char* path);
/* Adds what a file holds to the mesh's field, which must have its geometry and resolution. Out of memory, what was read
 * is kept. */
FT_API FTError ftLoadField(FTScene scene, uint32_t mesh, const char* path);
/* "meshes" "instances" "width" "height"; over all fields, after the first commit, "fields" "directions" "plane" "bytes"
 * "cells_baked", "cells_certified" (of these, those that answer at the tolerance; counted anew by each call),
 * "cells_full" and "memory_exceeded" (1: what does not fit is left to exact rays). */
FT_API FTError ftGetSceneInt(FTScene scene, const char* name, int64_t* value);
/* Of a mesh's field: "bytes" "cells_baked" "cells_certified" "cells_full"; all 0 if it has none. */
FT_API FTError ftGetMeshInt(FTScene scene, uint32_t mesh, const char* name, int64_t* value);
/* Of the rays of ftOccluded*() so far "certified_occlusion", of those of ftNearest() "certified_hits": shares that
 * fields or bounds answered, [0, 1]. */
FT_API FTError ftGetSceneFloat(FTScene scene, const char* name, double* value);

/* ---- Queries ----
 * Rays: float[3] origins and directions; one float as largest t each, null: infinite, negative: no ray (clear, miss);
 * `from` (may be null): uint32_t each, the instance that a ray leaves, or FT_NO_INSTANCE. Flat meshes do not hide rays
 * that leave them. Not finite origins and directions, directions of no length, and NaN as largest t are errors. */

/* result[i], a byte: FT_CLEAR or FT_BLOCKED. Fields answer what they certify, exact rays the rest. */
FT_API FTError ftOccluded(FTScene scene, const float* origins, size_t origin_stride, const float* directions,
                          size_t direction_stride, const float* t_max, size_t t_max_stride, const uint32_t* from,
                          size_t from_stride, size_t count, uint8_t* results, size_t result_stride);
/* The same without exact rays: also FT_UNDECIDED_OCCLUSION. */
FT_API FTError ftOccludedCertified(FTScene scene, const float* origins, size_t origin_stride, const float* directions,
                                   size_t direction_stride, const float* t_max, size_t t_max_stride,
                                   const uint32_t* from, size_t from_stride, size_t count, uint8_t* results,
                                   size_t result_stride);
/* status[i], a byte: FT_MISS, FT_HIT or FT_UNDECIDED_HIT. Of hits: t, unit geometric normal (float[3]) on the side that
 * the ray comes from, triangle of the mesh (of certified hits one near it) and instance; of others these are not
 * written. Each but `status` may be null. A certified hit lies within `max_error` x its distance of the surface, a
 * tangent in (0, 1]. Meshes without fields are traced, and never undecided; at tolerance 1 all are. */
FT_API FTError ftNearest(FTScene scene, float max_error, const float* origins, size_t origin_stride,
                         const float* directions, size_t direction_stride, const float* t_max, size_t t_max_stride,
                         const uint32_t* from, size_t from_stride, size_t count, uint8_t* status, size_t status_stride,
                         float* t, size_t t_stride, float* normals, size_t normal_stride, uint32_t* primitives,
                         size_t primitive_stride, uint32_t* instances, size_t instance_stride);
/* What points see of lights. A light: its shape and 9 floats, the centre c and half axes u, v. Rectangle: c + a u + b
 * v, a and b in [-1, 1]; disk: a^2 + b^2 <= 1; both seen on the side of u x v only. Sphere: radius |u|, v unused.
 * Points have unit geometric normals, and `from` as rays. Result of point i and light k at element i x light_count + k:
 * `shares` in [0, 1], the mean over 16 parts of the light's solid angle (disks: area) that lie above the point's
 * horizon and face it, 0 if none does; `certain` (may be null): how much of that was certified, the rest being one
 * exact ray a part. */
FT_API FTError ftLightVisibility(FTScene scene, const float* points, size_t point_stride, const float* normals,
                                 size_t normal_stride, const uint32_t* from, size_t from_stride, size_t point_count,
                                 const uint32_t* shapes, size_t shape_stride, const float* lights, size_t light_stride,
                                 size_t light_count, float* shares, size_t share_stride, float* certain,
                                 size_t certain_stride);
/* The cosine-weighted share of the sky that points on instances see: 1 is an open hemisphere. `from` is needed here.
 * The first call after each commit bakes direction maps. */
FT_API FTError ftSkyVisibility(FTScene scene, const float* points, size_t point_stride, const float* normals,
                               size_t normal_stride, const uint32_t* from, size_t from_stride, size_t point_count,
                               float* shares, size_t share_stride, float* certain, size_t certain_stride);

/* ---- Pictures ---- */

/* Linear radiance, RGB, row 0 at the top, of "width" x "height" pixels. Meshes, transforms and tolerance are those of
 * the last commit, all else as it was set last. */
FT_API FTError ftRender(FTScene scene, float* pixels, size_t pixel_stride, size_t row_stride);
/* To .exr or .png. */
FT_API FTError ftRenderToFile(FTScene scene, const char* path);

#ifdef __cplusplus
}
#endif
#endif

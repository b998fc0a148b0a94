/* Fieldtrace's instances within an Embree 3 scene of the caller. C99. Needs Embree's headers; the program links
 * libembree3, the same that Fieldtrace uses. */
#ifndef FIELDTRACE_EMBREE_H
#define FIELDTRACE_EMBREE_H

#include <embree3/rtcore.h>

#include "fieldtrace/fieldtrace.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Attaches each instance to an Embree scene of the device `embree`, as a user geometry of one primitive, and writes
 * their geometry IDs, one an instance in order (may be null). The caller then commits the Embree scene, and traces it
 * with 1, 4, 8 or 16 rays at a time or in streams. Occlusion is answered by fields where they are certain, and by exact
 * rays otherwise; nearest hits are exact, and fields spare rays that miss. Hits: geomID, primID the triangle, u and v
 * its barycentric coordinates, Ng the unit normal in world space, instID that of the traversal. Filter functions are
 * not called. Space: that of the Embree scene is the world of `scene`. After instances moved: ftCommitScene(), then
 * rtcCommitGeometry() of theirs and rtcCommitScene(). Attached instances keep the scene beyond the last release of its
 * handle, until they are detached. */
FT_API FTError ftAttachEmbree(FTScene scene, RTCDevice embree, RTCScene target, uint32_t* geometry_ids);
/* Detaches all that ftAttachEmbree() attached to `target`, which the caller then commits. No ray may be in it. Frees a
 * scene whose handle was released before: no other function takes a released handle. */
FT_API FTError ftDetachEmbree(FTScene scene, RTCScene target);

#ifdef __cplusplus
}
#endif

#endif

// The part of Open Image Denoise's C interface, version 2, that is called here. Declared anew, since packages of the
// library for Python come without its headers. Thread-safety: a device and its filters belong to one thread at a time.
#pragma once

#include <cstddef>

namespace fieldtrace {

extern "C" {

struct OIDNDeviceImpl;
struct OIDNFilterImpl;

OIDNDeviceImpl* oidnNewDevice(int type);
void oidnSetDeviceInt(OIDNDeviceImpl* device, const char* name, int value);
void oidnSetDeviceBool(OIDNDeviceImpl* device, const char* name, bool value);
int oidnGetDeviceInt(OIDNDeviceImpl* device, const char* name);
void oidnCommitDevice(OIDNDeviceImpl* device);
// The first error of the device since it was last asked, 0 for none; null: of this thread, without a device.
int oidnGetDeviceError(OIDNDeviceImpl* device, const char** message);
void oidnReleaseDevice(OIDNDeviceImpl* device);

OIDNFilterImpl* oidnNewFilter(OIDNDeviceImpl* device, const char* type);
// Strides of 0: pixels and rows without gaps.
void oidnSetSharedFilterImage(OIDNFilterImpl* filter, const char* name, void* pixels, int format, size_t width,
                              size_t height, size_t byte_offset, size_t pixel_byte_stride, size_t row_byte_stride);
void oidnSetFilterBool(OIDNFilterImpl* filter, const char* name, bool value);
void oidnCommitFilter(OIDNFilterImpl* filter);
void oidnExecuteFilter(OIDNFilterImpl* filter);
void oidnReleaseFilter(OIDNFilterImpl* filter);

}  // extern "C"

// Of its enumerations OIDNDeviceType and OIDNFormat.
enum : int { k_oidn_cpu = 1, k_oidn_float3 = 3 };

}  // namespace fieldtrace

#include "image/codecs/library_versions.h"

#include <OpenEXR/OpenEXRConfig.h>
#include <png.h>
#include <webp/decode.h>

// The only libjpeg header that contains its version.
#include <jconfig.h>

#include "absl/strings/str_cat.h"

#define TESSERA_TEXT(x) #x
#define TESSERA_VALUE_TEXT(x) TESSERA_TEXT(x)

namespace tessera::image {

std::vector<cli::LibraryVersion> library_versions() {
  const int webp = WebPGetDecoderVersion();  // one byte per part
  return {{"libpng", png_get_libpng_ver(nullptr)},
          {"libjpeg-turbo", TESSERA_VALUE_TEXT(LIBJPEG_TURBO_VERSION)},
          {"libwebp", absl::StrCat(webp >> 16, ".", webp >> 8 & 0xff, ".", webp & 0xff)},
          {"OpenEXR", OPENEXR_VERSION_STRING}};
}

}  // namespace tessera::image

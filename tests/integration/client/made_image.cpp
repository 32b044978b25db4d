#include "tests/integration/client/made_image.h"

#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>

namespace tessera::client {

void write_image(const std::string& path, int width, int height, int channels,
                 const std::vector<float>& pixels) {
  const bool png = path.find(".png") != std::string::npos;
  const OIIO::ImageSpec spec(width, height, channels,
                             png ? OIIO::TypeDesc::UINT8 : OIIO::TypeDesc::FLOAT);
  const auto output = OIIO::ImageOutput::create(path);
  ASSERT_NE(output, nullptr);
  EXPECT_TRUE(output->open(path, spec));
  EXPECT_TRUE(output->write_image(OIIO::TypeDesc::FLOAT, pixels.data()));
  EXPECT_TRUE(output->close());
}

}  // namespace tessera::client

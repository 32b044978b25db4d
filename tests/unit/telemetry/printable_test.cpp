#include "telemetry/log/printable.h"

#include <gtest/gtest.h>

#include <string>

namespace tessera {
namespace {

TEST(Printable, EscapesEveryControlCharacter) {
  EXPECT_EQ(printable(std::string("a\0b", 3)), "a\\x00b");
  EXPECT_EQ(printable("line\nnext\ttab\r"), "line\\nnext\\ttab\\x0d");
  EXPECT_EQ(printable("\x1b[31mred\x7f"), "\\x1b[31mred\\x7f");
  EXPECT_EQ(printable("\xc2\x9b"
                      "31m"),
            "\\x9b31m");  // C1's one-character form of ESC [
}

TEST(Printable, KeepsAllOtherText) {
  const std::string text = "Ärger ünd 水 «\xc2\xa0» \\n ~";
  EXPECT_EQ(printable(text), text);
  EXPECT_FALSE(has_control_characters(text));
  EXPECT_EQ(printable("cut \xc2"), "cut \xc2");  // of a character that was cut off
}

TEST(Printable, FindsControlCharactersAnywhere) {
  for (int byte = 0; byte < 256; ++byte) {
    const std::string text = std::string("text") + static_cast<char>(byte);
    EXPECT_EQ(has_control_characters(text), byte < 0x20 || byte == 0x7F) << byte;
    EXPECT_EQ(has_control_characters("\xc2" + text.substr(4)),
              byte < 0x20 || byte == 0x7F || (byte >= 0x80 && byte < 0xA0))
        << byte;
  }
  EXPECT_TRUE(has_control_characters(std::string("\0hidden", 7)));
}

}  // namespace
}  // namespace tessera

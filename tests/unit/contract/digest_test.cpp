#include "contract/digest.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>

namespace tessera::contract {
namespace {

TEST(Digest, Sha256MatchesFipsExamples) {
  // FIPS 180-4 examples.
  EXPECT_EQ(sha256(std::string_view("abc")).hex(),
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(sha256(std::string_view()).hex(),
            "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
}

TEST(Digest, IncrementalMatchesOneShot) {
  const std::string text(100'000, 'x');
  for (const std::size_t cut : {std::size_t{0}, std::size_t{1}, std::size_t{63}, std::size_t{64},
                                std::size_t{65}, std::size_t{99'999}}) {
    Hasher hasher;
    hasher.update(std::string_view(text).substr(0, cut));
    hasher.update(std::string_view(text).substr(cut));
    EXPECT_EQ(hasher.finish(), sha256(text)) << cut;
  }
}

TEST(Digest, SetDigestIgnoresOrderAndRepeats) {
  const Digest a = sha256(std::string_view("a")), b = sha256(std::string_view("b"));
  const Digest both = sha256(std::min(a, b).binary() + std::max(a, b).binary());
  EXPECT_EQ(sha256_of_set({a, b}), both);
  EXPECT_EQ(sha256_of_set({b, a, b}), both);
}

TEST(Digest, HexAndBinaryRoundTrip) {
  const Digest digest = sha256(std::string_view("tessera"));
  EXPECT_EQ(Digest::from_hex(digest.hex()), digest);
  EXPECT_EQ(Digest::from_binary(digest.binary()), digest);
  std::string upper = digest.hex();
  for (char& c : upper) c = static_cast<char>(std::toupper(c));
  EXPECT_EQ(Digest::from_hex(upper), digest);
}

TEST(Digest, MalformedHexIsRejected) {
  const std::string hex = sha256(std::string_view("x")).hex();
  EXPECT_FALSE(Digest::from_hex(hex.substr(1)));
  EXPECT_FALSE(Digest::from_hex(hex + "0"));
  EXPECT_FALSE(Digest::from_hex("g" + hex.substr(1)));
  EXPECT_FALSE(Digest::from_hex(" " + hex.substr(1)));
  EXPECT_FALSE(Digest::from_hex(""));
  EXPECT_FALSE(Digest::from_binary(std::string(31, 'x')));
  EXPECT_FALSE(Digest::from_binary(std::string(33, 'x')));
}

TEST(Hmac, MatchesRfc4231Examples) {
  // RFC 4231, test cases 1 and 2.
  EXPECT_EQ(hmac_sha256(std::string(20, '\x0b'), "Hi There").hex(),
            "b0344c61d8db38535ca8afceaf0bf12b881dc200c9833da726e9376c2e32cff7");
  EXPECT_EQ(hmac_sha256("Jefe", "what do ya want for nothing?").hex(),
            "5bdcc146bf60754e6a042426089575c75a003f089d2739839dec58b964ec3843");
}

TEST(ConstantTimeEquality, AgreesWithEquality) {
  const Digest a = sha256(std::string_view("a"));
  EXPECT_TRUE(equal_in_constant_time(a, a));
  for (std::size_t i = 0; i < a.bytes.size(); ++i) {
    for (int bit = 0; bit < 8; ++bit) {
      Digest b = a;
      b.bytes[i] = static_cast<std::uint8_t>(b.bytes[i] ^ (1 << bit));
      ASSERT_FALSE(equal_in_constant_time(a, b));
    }
  }
}

}  // namespace
}  // namespace tessera::contract

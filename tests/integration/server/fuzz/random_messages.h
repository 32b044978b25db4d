#pragma once

#include <google/protobuf/message.h>

#include <string>
#include <vector>

#include "tests/support/dice.h"

namespace tessera::server {

/// Sets random fields of `message`, and of the messages in it, to random values, valid and not.
/// `words`: what text fields may be set to, besides text that is no name.
void scramble(google::protobuf::Message& message, const std::vector<std::string>& words,
              testing::Dice& dice, int depth = 0);

/// Returns random bytes, up to 200.
std::string random_bytes(testing::Dice& dice);

}  // namespace tessera::server

#include "tests/integration/server/fuzz/random_messages.h"

#include <cstdint>
#include <iterator>
#include <limits>

namespace tessera::server {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using testing::Dice;

constexpr int kMaxDepth = 4;

std::int64_t random_integer(Dice& dice) {
  constexpr std::int64_t kNotable[] = {0, 1, -1, 2, 16, 1000, 1 << 20, 1LL << 40, -(1 << 20)};
  switch (dice.below(4)) {
    case 0:
      return std::numeric_limits<std::int64_t>::min();
    case 1:
      return std::numeric_limits<std::int64_t>::max();
    case 2:
      return dice.below(100);
    default:
      return kNotable[dice.below(std::size(kNotable))];
  }
}

double random_real(Dice& dice) {
  constexpr double kNotable[] = {0,
                                 -1,
                                 0.5,
                                 1,
                                 1e300,
                                 -1e-300,
                                 std::numeric_limits<double>::infinity(),
                                 std::numeric_limits<double>::quiet_NaN()};
  return kNotable[dice.below(std::size(kNotable))];
}

std::string random_text(const std::vector<std::string>& words, Dice& dice) {
  switch (dice.below(8)) {
    case 0:
      return {};
    case 1:
      return std::string("nul\0inside", 10);
    case 2:
      return "two\nlines";
    case 3:
      return std::string(5000, 'x');
    case 4:
      return "../../etc/passwd";
    default:
      return words[static_cast<std::size_t>(dice.below(static_cast<int>(words.size())))];
  }
}

void set_field(Message& message, const FieldDescriptor& field,
               const std::vector<std::string>& words, Dice& dice) {
  const auto* reflection = message.GetReflection();
  const auto put = [&](auto set, auto add, auto value) {
    if (field.is_repeated()) {
      (reflection->*add)(&message, &field, value);
    } else {
      (reflection->*set)(&message, &field, value);
    }
  };
  using Reflection = google::protobuf::Reflection;
  switch (field.cpp_type()) {
    case FieldDescriptor::CPPTYPE_INT32:
      return put(&Reflection::SetInt32, &Reflection::AddInt32,
                 static_cast<std::int32_t>(random_integer(dice)));
    case FieldDescriptor::CPPTYPE_INT64:
      return put(&Reflection::SetInt64, &Reflection::AddInt64, random_integer(dice));
    case FieldDescriptor::CPPTYPE_DOUBLE:
      return put(&Reflection::SetDouble, &Reflection::AddDouble, random_real(dice));
    case FieldDescriptor::CPPTYPE_FLOAT:
      return put(&Reflection::SetFloat, &Reflection::AddFloat,
                 static_cast<float>(random_real(dice)));
    case FieldDescriptor::CPPTYPE_BOOL:
      return put(&Reflection::SetBool, &Reflection::AddBool, dice.one_in(2));
    case FieldDescriptor::CPPTYPE_ENUM:
      return put(&Reflection::SetEnumValue, &Reflection::AddEnumValue, dice.below(9) - 1);
    case FieldDescriptor::CPPTYPE_STRING: {
      const bool is_bytes = field.type() == FieldDescriptor::TYPE_BYTES;
      std::string text = is_bytes ? random_bytes(dice) : random_text(words, dice);
      if (field.is_repeated()) return reflection->AddString(&message, &field, std::move(text));
      return reflection->SetString(&message, &field, std::move(text));
    }
    default:
      return;
  }
}

}  // namespace

std::string random_bytes(Dice& dice) {
  std::string bytes(static_cast<std::size_t>(dice.one_in(3) ? 32 : dice.below(200)), '\0');
  for (char& byte : bytes) byte = static_cast<char>(dice.below(256));
  return bytes;
}

void scramble(Message& message, const std::vector<std::string>& words, Dice& dice, int depth) {
  const auto* descriptor = message.GetDescriptor();
  const auto* reflection = message.GetReflection();
  for (int i = 0; i < descriptor->field_count(); ++i) {
    const FieldDescriptor& field = *descriptor->field(i);
    if (!dice.one_in(3)) continue;
    if (dice.one_in(6)) {
      reflection->ClearField(&message, &field);
    } else if (field.cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) {
      set_field(message, field, words, dice);
    } else if (depth < kMaxDepth) {
      const int present = field.is_repeated() ? reflection->FieldSize(message, &field) : 0;
      Message* part = nullptr;
      if (!field.is_repeated()) {
        part = reflection->MutableMessage(&message, &field);
      } else if (present > 0 && dice.one_in(2)) {
        part = reflection->MutableRepeatedMessage(&message, &field, dice.below(present));
      } else {
        part = reflection->AddMessage(&message, &field);
      }
      scramble(*part, words, dice, depth + 1);
    }
  }
}

}  // namespace tessera::server

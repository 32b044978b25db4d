#include <google/protobuf/descriptor.h>
#include <google/protobuf/descriptor.pb.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <fstream>
#include <functional>
#include <set>
#include <string>
#include <vector>

namespace tessera {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::DescriptorPool;
using google::protobuf::EnumDescriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::FileDescriptor;
using google::protobuf::MethodDescriptor;
using google::protobuf::ServiceDescriptor;

/// The protos with their comments, as protoc wrote them for this test.
class ProtoStyle : public testing::Test {
 protected:
  void SetUp() override {
    std::ifstream input(TESSERA_DESCRIPTOR_SET, std::ios::binary);
    google::protobuf::FileDescriptorSet set;
    ASSERT_TRUE(set.ParseFromIstream(&input)) << TESSERA_DESCRIPTOR_SET;
    for (const auto& file : set.file()) {
      const FileDescriptor* built = pool_.BuildFile(file);
      ASSERT_NE(built, nullptr) << file.name();
      if (built->package() == "tessera.v1") files_.push_back(built);
    }
    ASSERT_GE(files_.size(), 5u) << "no proto files found";
  }

  void for_each_message(const std::function<void(const Descriptor&)>& visit) const {
    const std::function<void(const Descriptor&)> walk = [&](const Descriptor& message) {
      visit(message);
      for (int i = 0; i < message.nested_type_count(); ++i) walk(*message.nested_type(i));
    };
    for (const FileDescriptor* file : files_) {
      for (int i = 0; i < file->message_type_count(); ++i) walk(*file->message_type(i));
    }
  }
  void for_each_field(const std::function<void(const FieldDescriptor&)>& visit) const {
    for_each_message([&](const Descriptor& message) {
      for (int i = 0; i < message.field_count(); ++i) visit(*message.field(i));
    });
  }
  void for_each_enum(const std::function<void(const EnumDescriptor&)>& visit) const {
    for (const FileDescriptor* file : files_) {
      for (int i = 0; i < file->enum_type_count(); ++i) visit(*file->enum_type(i));
    }
    for_each_message([&](const Descriptor& message) {
      for (int i = 0; i < message.enum_type_count(); ++i) visit(*message.enum_type(i));
    });
  }
  void for_each_rpc(const std::function<void(const MethodDescriptor&)>& visit) const {
    for (const FileDescriptor* file : files_) {
      for (int i = 0; i < file->service_count(); ++i) {
        for (int j = 0; j < file->service(i)->method_count(); ++j) {
          visit(*file->service(i)->method(j));
        }
      }
    }
  }

  DescriptorPool pool_;
  std::vector<const FileDescriptor*> files_;
};

std::string upper_snake(const std::string& pascal) {
  std::string upper;
  for (std::size_t i = 0; i < pascal.size(); ++i) {
    const auto letter = static_cast<unsigned char>(pascal[i]);
    if (i > 0 && std::isupper(letter)) upper.push_back('_');
    upper.push_back(static_cast<char>(std::toupper(letter)));
  }
  return upper;
}

bool ends_with(const std::string& text, const std::string& end) {
  return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

template <typename Element>
std::string comment_of(const Element& element) {
  google::protobuf::SourceLocation location;
  if (!element.GetSourceLocation(&location)) return "";
  return location.leading_comments + location.trailing_comments;
}

TEST_F(ProtoStyle, PathsMatchPackages) {
  for (const FileDescriptor* file : files_) {
    EXPECT_EQ(file->name().rfind("tessera/v1/", 0), 0u) << file->name();
    EXPECT_LE(file->service_count(), 1) << file->name() << ": one service a file";
  }
}

TEST_F(ProtoStyle, EveryRpcHasItsOwnRequestAndResponse) {
  // Streams have names of their own, and so do their messages.
  std::set<std::string> used;
  for_each_rpc([&](const MethodDescriptor& rpc) {
    EXPECT_EQ(rpc.input_type()->name(), rpc.name() + "Request") << rpc.full_name();
    EXPECT_EQ(rpc.output_type()->name(), rpc.name() + "Response") << rpc.full_name();
    EXPECT_TRUE(used.insert(rpc.input_type()->full_name()).second) << rpc.full_name();
    EXPECT_TRUE(used.insert(rpc.output_type()->full_name()).second) << rpc.full_name();
  });
  EXPECT_GE(used.size(), 30u);
}

TEST_F(ProtoStyle, EveryRpcDocumentsErrorsAndIdempotency) {
  for_each_rpc([](const MethodDescriptor& rpc) {
    const std::string comment = comment_of(rpc);
    EXPECT_FALSE(comment.empty()) << rpc.full_name();
    const bool says_errors = comment.find("Errors:") != std::string::npos;
    const bool says_repeating = comment.find("dempotent") != std::string::npos ||
                                comment.find("epeating") != std::string::npos ||
                                comment.find("always safe") != std::string::npos;
    EXPECT_TRUE(says_errors || says_repeating) << rpc.full_name();
    EXPECT_TRUE(says_repeating) << rpc.full_name() << ": may it be repeated?";
  });
}

TEST_F(ProtoStyle, EnumZeroIsUnspecifiedAndNamesHavePrefix) {
  for_each_enum([](const EnumDescriptor& enumeration) {
    const std::string prefix = upper_snake(enumeration.name()) + "_";
    EXPECT_EQ(enumeration.value(0)->number(), 0) << enumeration.full_name();
    EXPECT_EQ(enumeration.value(0)->name(), prefix + "UNSPECIFIED") << enumeration.full_name();
    for (int i = 0; i < enumeration.value_count(); ++i) {
      EXPECT_EQ(enumeration.value(i)->name().rfind(prefix, 0), 0u)
          << enumeration.value(i)->full_name();
    }
  });
}

TEST_F(ProtoStyle, NumbersAreSigned) {
  for_each_field([](const FieldDescriptor& field) {
    EXPECT_NE(field.cpp_type(), FieldDescriptor::CPPTYPE_UINT32) << field.full_name();
    EXPECT_NE(field.cpp_type(), FieldDescriptor::CPPTYPE_UINT64) << field.full_name();
  });
}

TEST_F(ProtoStyle, FieldsAreSnakeCaseAndCountsEndInCount) {
  for_each_field([](const FieldDescriptor& field) {
    for (const char letter : field.name()) {
      EXPECT_TRUE(std::islower(static_cast<unsigned char>(letter)) || letter == '_' ||
                  std::isdigit(static_cast<unsigned char>(letter)))
          << field.full_name();
    }
    EXPECT_FALSE(field.name().rfind("num_", 0) == 0) << field.full_name();
    EXPECT_FALSE(ends_with(field.name(), "_ms") || ends_with(field.name(), "_kb"))
        << field.full_name() << ": spans are Durations, sizes are bytes";
  });
}

TEST_F(ProtoStyle, MeasuresNameTheirUnit) {
  const std::vector<std::string> measures = {"width", "height", "size",    "rss",   "rotation",
                                             "time",  "span",   "seconds", "memory"};
  const std::vector<std::string> units = {"_px",    "_bytes", "_deg",   "_time", "_seconds",
                                          "_count", "_size",  "seconds"};  // page_size is a count
  for_each_field([&](const FieldDescriptor& field) {
    const bool is_number = field.cpp_type() != FieldDescriptor::CPPTYPE_STRING &&
                           field.cpp_type() != FieldDescriptor::CPPTYPE_ENUM &&
                           field.cpp_type() != FieldDescriptor::CPPTYPE_BOOL;
    if (!is_number) return;
    const std::string& name = field.name();
    const bool is_measure = std::any_of(measures.begin(), measures.end(), [&](const auto& m) {
      return name == m || name.rfind(m + "_", 0) == 0 || ends_with(name, "_" + m);
    });
    if (!is_measure) return;
    EXPECT_TRUE(std::any_of(units.begin(), units.end(), [&](const auto& unit) {
      return ends_with(name, unit);
    })) << field.full_name();
  });
}

TEST_F(ProtoStyle, TimesAreTimestampsOrDurations) {
  for_each_field([](const FieldDescriptor& field) {
    if (ends_with(field.name(), "_time")) {
      ASSERT_EQ(field.type(), FieldDescriptor::TYPE_MESSAGE) << field.full_name();
      EXPECT_EQ(field.message_type()->full_name(), "google.protobuf.Timestamp")
          << field.full_name();
    }
    if (field.type() == FieldDescriptor::TYPE_MESSAGE &&
        field.message_type()->full_name() == "google.protobuf.Timestamp") {
      EXPECT_TRUE(ends_with(field.name(), "_time")) << field.full_name();
    }
  });
}

TEST_F(ProtoStyle, DigestsAreBytes) {
  for_each_field([](const FieldDescriptor& field) {
    if (field.name() != "sha256" && !ends_with(field.name(), "_sha256")) return;
    EXPECT_EQ(field.type(), FieldDescriptor::TYPE_BYTES) << field.full_name();
  });
}

/// Questions about a field (AIP-192) must be answered by its comment, its message's or group's
/// comment, or its name.
TEST_F(ProtoStyle, EverythingIsCommented) {
  for (const FileDescriptor* file : files_) {
    for (int i = 0; i < file->service_count(); ++i) {
      EXPECT_FALSE(comment_of(*file->service(i)).empty()) << file->service(i)->full_name();
    }
  }
  int fields = 0, commented = 0;
  for_each_message([&](const Descriptor& message) {
    const bool is_pair =
        ends_with(message.name(), "Request") || ends_with(message.name(), "Response");
    bool has_comment = !comment_of(message).empty();
    for (int i = 0; i < message.field_count(); ++i) {
      const bool is = !comment_of(*message.field(i)).empty();
      ++fields;
      commented += is;
      has_comment = has_comment || is;
    }
    // Request and response are explained at their rpc; other messages by their comment or their
    // fields' comments.
    EXPECT_TRUE(has_comment || is_pair || message.field_count() == 0) << message.full_name();
  });
  // The others are covered by a neighbour's comment (first_tile, tile_count) or repeat a field that
  // is explained at its first use (job_id).
  EXPECT_GT(commented, 90) << "of " << fields << " fields";
}

}  // namespace
}  // namespace tessera

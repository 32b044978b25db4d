#pragma once

#include "worker/gltf/validate/findings/findings.h"

/// The rules that are checked (docs/reference/validation.md).
namespace tessera::render::rules {

inline constexpr ValidationRule kIoError{"IO_ERROR", FindingSeverity::error,
                                         "the file cannot be read"};
inline constexpr ValidationRule kArrayLengthNotInList{
    "ARRAY_LENGTH_NOT_IN_LIST", FindingSeverity::error, "the array has the wrong length"};
inline constexpr ValidationRule kArrayTypeMismatch{"ARRAY_TYPE_MISMATCH", FindingSeverity::error,
                                                   "an element of the array has the wrong type"};
/// Of Tessera alone: the Khronos validator does not see repeated keys.
inline constexpr ValidationRule kDuplicateKey{"DUPLICATE_KEY", FindingSeverity::error,
                                              "the object has this key more than once"};
inline constexpr ValidationRule kDuplicateElements{"DUPLICATE_ELEMENTS", FindingSeverity::error,
                                                   "the element occurs before in the array"};
inline constexpr ValidationRule kEmptyEntity{"EMPTY_ENTITY", FindingSeverity::error,
                                             "must not be empty"};
inline constexpr ValidationRule kInvalidIndex{"INVALID_INDEX", FindingSeverity::error,
                                              "an index must be a non-negative integer"};
inline constexpr ValidationRule kInvalidJson{"INVALID_JSON", FindingSeverity::error,
                                             "not valid JSON"};
inline constexpr ValidationRule kInvalidUri{"INVALID_URI", FindingSeverity::error,
                                            "not a valid URI"};
inline constexpr ValidationRule kOneOfMismatch{"ONE_OF_MISMATCH", FindingSeverity::error,
                                               "exactly one of the alternatives must be given"};
inline constexpr ValidationRule kPatternMismatch{"PATTERN_MISMATCH", FindingSeverity::error,
                                                 "the text does not have the required form"};
inline constexpr ValidationRule kTypeMismatch{"TYPE_MISMATCH", FindingSeverity::error,
                                              "the value has the wrong type"};
inline constexpr ValidationRule kUndefinedProperty{"UNDEFINED_PROPERTY", FindingSeverity::error,
                                                   "a required property is missing"};
inline constexpr ValidationRule kUnexpectedProperty{"UNEXPECTED_PROPERTY", FindingSeverity::warning,
                                                    "glTF does not define this property here"};
inline constexpr ValidationRule kUnsatisfiedDependency{
    "UNSATISFIED_DEPENDENCY", FindingSeverity::error, "needs another property that is missing"};
inline constexpr ValidationRule kValueMultipleOf{"VALUE_MULTIPLE_OF", FindingSeverity::error,
                                                 "the value must be a multiple"};
inline constexpr ValidationRule kValueNotInList{"VALUE_NOT_IN_LIST", FindingSeverity::warning,
                                                "the value is not one of those that glTF defines"};
inline constexpr ValidationRule kValueNotInRange{"VALUE_NOT_IN_RANGE", FindingSeverity::error,
                                                 "the value is out of range"};
inline constexpr ValidationRule kAccessorMatrixAlignment{
    "ACCESSOR_MATRIX_ALIGNMENT", FindingSeverity::error,
    "matrices must begin at a multiple of 4 bytes"};
inline constexpr ValidationRule kAccessorNormalizedInvalid{
    "ACCESSOR_NORMALIZED_INVALID", FindingSeverity::error,
    "only 8-bit and 16-bit integers can be normalized"};
inline constexpr ValidationRule kAccessorOffsetAlignment{
    "ACCESSOR_OFFSET_ALIGNMENT", FindingSeverity::error,
    "the offset must be a multiple of the component's size"};
inline constexpr ValidationRule kAccessorSparseCountOutOfRange{
    "ACCESSOR_SPARSE_COUNT_OUT_OF_RANGE", FindingSeverity::error,
    "more elements are replaced than the accessor has"};
inline constexpr ValidationRule kAnimationChannelTargetNodeSkin{
    "ANIMATION_CHANNEL_TARGET_NODE_SKIN", FindingSeverity::warning,
    "the transform of a node with a skin has no effect"};
inline constexpr ValidationRule kAssetMinVersionGreaterThanVersion{
    "ASSET_MIN_VERSION_GREATER_THAN_VERSION", FindingSeverity::error,
    "minVersion is above version"};
inline constexpr ValidationRule kBufferDataUriMimeTypeInvalid{
    "BUFFER_DATA_URI_MIME_TYPE_INVALID", FindingSeverity::error,
    "the media type must be application/octet-stream or application/gltf-buffer"};
inline constexpr ValidationRule kBufferViewInvalidByteStride{
    "BUFFER_VIEW_INVALID_BYTE_STRIDE", FindingSeverity::error,
    "only buffer views with vertex attributes can have a byteStride"};
inline constexpr ValidationRule kBufferViewTooBigByteStride{
    "BUFFER_VIEW_TOO_BIG_BYTE_STRIDE", FindingSeverity::error, "byteStride is above byteLength"};
inline constexpr ValidationRule kCameraXmagYmagNegative{"CAMERA_XMAG_YMAG_NEGATIVE",
                                                        FindingSeverity::warning,
                                                        "the magnification should not be negative"};
inline constexpr ValidationRule kCameraXmagYmagZero{"CAMERA_XMAG_YMAG_ZERO", FindingSeverity::error,
                                                    "the magnification must not be 0"};
inline constexpr ValidationRule kCameraYfovGequalPi{
    "CAMERA_YFOV_GEQUAL_PI", FindingSeverity::warning, "yfov should be below pi"};
inline constexpr ValidationRule kCameraZfarLequalZnear{
    "CAMERA_ZFAR_LEQUAL_ZNEAR", FindingSeverity::error, "zfar must be above znear"};
inline constexpr ValidationRule kExtraProperty{"EXTRA_PROPERTY", FindingSeverity::information,
                                               "the property has no effect here"};
inline constexpr ValidationRule kInvalidExtensionNameFormat{
    "INVALID_EXTENSION_NAME_FORMAT", FindingSeverity::warning,
    "the name should be a prefix in capitals, _ and a name"};
inline constexpr ValidationRule kInvalidGlValue{"INVALID_GL_VALUE", FindingSeverity::error,
                                                "the component type cannot represent the value"};
inline constexpr ValidationRule kKhrAnimationPointerAnimationChannelTargetNode{
    "KHR_ANIMATION_POINTER_ANIMATION_CHANNEL_TARGET_NODE", FindingSeverity::error,
    "the target of an animation pointer must not have a node"};
inline constexpr ValidationRule kKhrAnimationPointerAnimationChannelTargetPath{
    "KHR_ANIMATION_POINTER_ANIMATION_CHANNEL_TARGET_PATH", FindingSeverity::error,
    "the path of an animation pointer must be \"pointer\""};
inline constexpr ValidationRule kKhrLightsPunctualLightSpotAngles{
    "KHR_LIGHTS_PUNCTUAL_LIGHT_SPOT_ANGLES", FindingSeverity::error,
    "outerConeAngle must be above innerConeAngle"};
inline constexpr ValidationRule kKhrMaterialsAnisotropyAnisotropyTextureTexcoord{
    "KHR_MATERIALS_ANISOTROPY_ANISOTROPY_TEXTURE_TEXCOORD", FindingSeverity::warning,
    "should use the texture coordinates of the normal texture"};
inline constexpr ValidationRule kKhrMaterialsClearcoatClearcoatNormalTextureTexcoord{
    "KHR_MATERIALS_CLEARCOAT_CLEARCOAT_NORMAL_TEXTURE_TEXCOORD", FindingSeverity::warning,
    "should use the texture coordinates of the normal texture"};
inline constexpr ValidationRule kKhrMaterialsDispersionNoVolume{
    "KHR_MATERIALS_DISPERSION_NO_VOLUME", FindingSeverity::warning,
    "has no effect without KHR_materials_volume"};
inline constexpr ValidationRule kKhrMaterialsEmissiveStrengthZeroFactor{
    "KHR_MATERIALS_EMISSIVE_STRENGTH_ZERO_FACTOR", FindingSeverity::warning,
    "has no effect, as emissiveFactor is 0"};
inline constexpr ValidationRule kKhrMaterialsIridescenceThicknessRangeWithoutTexture{
    "KHR_MATERIALS_IRIDESCENCE_THICKNESS_RANGE_WITHOUT_TEXTURE", FindingSeverity::information,
    "has no effect without a thickness texture"};
inline constexpr ValidationRule kKhrMaterialsIridescenceThicknessTextureUnused{
    "KHR_MATERIALS_IRIDESCENCE_THICKNESS_TEXTURE_UNUSED", FindingSeverity::information,
    "the texture has no effect, as minimum and maximum are equal"};
inline constexpr ValidationRule kKhrMaterialsVolumeDoubleSided{
    "KHR_MATERIALS_VOLUME_DOUBLE_SIDED", FindingSeverity::warning,
    "a volume should not have a double-sided material"};
inline constexpr ValidationRule kKhrMaterialsVolumeNoTransmission{
    "KHR_MATERIALS_VOLUME_NO_TRANSMISSION", FindingSeverity::warning,
    "needs an extension that transmits light through the surface"};
inline constexpr ValidationRule kMaterialAlphaCutoffInvalidMode{
    "MATERIAL_ALPHA_CUTOFF_INVALID_MODE", FindingSeverity::warning,
    "alphaCutoff has an effect only in alphaMode MASK"};
inline constexpr ValidationRule kMeshInvalidWeightsCount{
    "MESH_INVALID_WEIGHTS_COUNT", FindingSeverity::error,
    "the number of weights is not that of the morph targets"};
inline constexpr ValidationRule kMeshPrimitivesUnequalTargetsCount{
    "MESH_PRIMITIVES_UNEQUAL_TARGETS_COUNT", FindingSeverity::error,
    "all primitives of a mesh must have as many morph targets"};
inline constexpr ValidationRule kMeshPrimitiveIndexedSemanticContinuity{
    "MESH_PRIMITIVE_INDEXED_SEMANTIC_CONTINUITY", FindingSeverity::error,
    "numbered attributes must count from 0 without gaps"};
inline constexpr ValidationRule kMeshPrimitiveInvalidAttribute{
    "MESH_PRIMITIVE_INVALID_ATTRIBUTE", FindingSeverity::error,
    "glTF does not define this attribute"};
inline constexpr ValidationRule kMeshPrimitiveJointsWeightsMismatch{
    "MESH_PRIMITIVE_JOINTS_WEIGHTS_MISMATCH", FindingSeverity::error,
    "there must be as many JOINTS as WEIGHTS"};
inline constexpr ValidationRule kMeshPrimitiveNoPosition{
    "MESH_PRIMITIVE_NO_POSITION", FindingSeverity::warning, "the primitive has no POSITION"};
inline constexpr ValidationRule kMeshPrimitiveTangentWithoutNormal{
    "MESH_PRIMITIVE_TANGENT_WITHOUT_NORMAL", FindingSeverity::warning,
    "TANGENT has no effect without NORMAL"};
inline constexpr ValidationRule kMultipleExtensions{
    "MULTIPLE_EXTENSIONS", FindingSeverity::warning,
    "may not be combined with other extensions of the object"};
inline constexpr ValidationRule kNodeEmpty{"NODE_EMPTY", FindingSeverity::information,
                                           "the node has no content"};
inline constexpr ValidationRule kNodeMatrixDefault{
    "NODE_MATRIX_DEFAULT", FindingSeverity::information, "the identity need not be given"};
inline constexpr ValidationRule kNodeMatrixNonTrs{
    "NODE_MATRIX_NON_TRS", FindingSeverity::error,
    "the matrix is not a translation, rotation and scale"};
inline constexpr ValidationRule kNodeMatrixTrs{
    "NODE_MATRIX_TRS", FindingSeverity::error,
    "a node has either a matrix or translation, rotation and scale"};
inline constexpr ValidationRule kNodeSkinnedMeshLocalTransforms{
    "NODE_SKINNED_MESH_LOCAL_TRANSFORMS", FindingSeverity::warning,
    "the transform of a node with a skin has no effect"};
inline constexpr ValidationRule kNodeSkinnedMeshNonRoot{
    "NODE_SKINNED_MESH_NON_ROOT", FindingSeverity::warning,
    "the parents of a node with a skin have no effect on it"};
inline constexpr ValidationRule kNodeSkinNoScene{
    "NODE_SKIN_NO_SCENE", FindingSeverity::error,
    "a scene has this node but not the joints of its skin"};
inline constexpr ValidationRule kNonObjectExtras{"NON_OBJECT_EXTRAS", FindingSeverity::information,
                                                 "extras should be an object"};
inline constexpr ValidationRule kNonRelativeUri{"NON_RELATIVE_URI", FindingSeverity::warning,
                                                "the URI is not a relative path"};
inline constexpr ValidationRule kNonRequiredExtension{
    "NON_REQUIRED_EXTENSION", FindingSeverity::error,
    "the extension must be listed in extensionsRequired"};
inline constexpr ValidationRule kRotationNonUnit{"ROTATION_NON_UNIT", FindingSeverity::error,
                                                 "the quaternion must have unit length"};
inline constexpr ValidationRule kSkinNoCommonRoot{"SKIN_NO_COMMON_ROOT", FindingSeverity::error,
                                                  "the joints must have a common root"};
inline constexpr ValidationRule kSkinSkeletonInvalid{
    "SKIN_SKELETON_INVALID", FindingSeverity::error,
    "the skeleton must be an ancestor of all joints"};
inline constexpr ValidationRule kUnknownAssetMajorVersion{
    "UNKNOWN_ASSET_MAJOR_VERSION", FindingSeverity::error, "unknown major version of glTF"};
inline constexpr ValidationRule kUnknownAssetMinorVersion{
    "UNKNOWN_ASSET_MINOR_VERSION", FindingSeverity::warning, "unknown minor version of glTF"};
inline constexpr ValidationRule kUnusedExtensionRequired{
    "UNUSED_EXTENSION_REQUIRED", FindingSeverity::error,
    "a required extension must be listed in extensionsUsed"};
inline constexpr ValidationRule kAccessorSmallBytestride{
    "ACCESSOR_SMALL_BYTESTRIDE", FindingSeverity::error,
    "the byteStride of the buffer view is below the size of an element"};
inline constexpr ValidationRule kAccessorTooLong{"ACCESSOR_TOO_LONG", FindingSeverity::error,
                                                 "the accessor does not fit its buffer view"};
inline constexpr ValidationRule kAccessorTotalOffsetAlignment{
    "ACCESSOR_TOTAL_OFFSET_ALIGNMENT", FindingSeverity::error,
    "the offset in the buffer must be a multiple of the component's size"};
inline constexpr ValidationRule kAccessorUsageOverride{
    "ACCESSOR_USAGE_OVERRIDE", FindingSeverity::error,
    "the accessor is used in another role before"};
inline constexpr ValidationRule kAnimationChannelTargetNodeMatrix{
    "ANIMATION_CHANNEL_TARGET_NODE_MATRIX", FindingSeverity::error,
    "a node with a matrix cannot be animated"};
inline constexpr ValidationRule kAnimationChannelTargetNodeWeightsNoMorphs{
    "ANIMATION_CHANNEL_TARGET_NODE_WEIGHTS_NO_MORPHS", FindingSeverity::error,
    "the mesh has no morph targets"};
inline constexpr ValidationRule kAnimationDuplicateTargets{
    "ANIMATION_DUPLICATE_TARGETS", FindingSeverity::error, "a later channel has the same target"};
inline constexpr ValidationRule kAnimationSamplerAccessorWithBytestride{
    "ANIMATION_SAMPLER_ACCESSOR_WITH_BYTESTRIDE", FindingSeverity::error,
    "the buffer view of an animation must not have a byteStride"};
inline constexpr ValidationRule kAnimationSamplerInputAccessorInvalidFormat{
    "ANIMATION_SAMPLER_INPUT_ACCESSOR_INVALID_FORMAT", FindingSeverity::error,
    "times must be float scalars"};
inline constexpr ValidationRule kAnimationSamplerInputAccessorTooFewElements{
    "ANIMATION_SAMPLER_INPUT_ACCESSOR_TOO_FEW_ELEMENTS", FindingSeverity::error,
    "a cubic spline needs two keys"};
inline constexpr ValidationRule kAnimationSamplerInputAccessorWithoutBounds{
    "ANIMATION_SAMPLER_INPUT_ACCESSOR_WITHOUT_BOUNDS", FindingSeverity::error,
    "times need min and max"};
inline constexpr ValidationRule kAnimationSamplerOutputAccessorInvalidCount{
    "ANIMATION_SAMPLER_OUTPUT_ACCESSOR_INVALID_COUNT", FindingSeverity::error,
    "wrong number of animated values"};
inline constexpr ValidationRule kAnimationSamplerOutputAccessorInvalidFormat{
    "ANIMATION_SAMPLER_OUTPUT_ACCESSOR_INVALID_FORMAT", FindingSeverity::error,
    "wrong type of animated values"};
inline constexpr ValidationRule kBufferMissingGlbData{
    "BUFFER_MISSING_GLB_DATA", FindingSeverity::error, "the file has no binary chunk"};
inline constexpr ValidationRule kBufferViewTargetMissing{
    "BUFFER_VIEW_TARGET_MISSING", FindingSeverity::hint, "the buffer view should have a target"};
inline constexpr ValidationRule kBufferViewTargetOverride{
    "BUFFER_VIEW_TARGET_OVERRIDE", FindingSeverity::error,
    "the buffer view has another target or role before"};
inline constexpr ValidationRule kBufferViewTooLong{"BUFFER_VIEW_TOO_LONG", FindingSeverity::error,
                                                   "the buffer view does not fit its buffer"};
inline constexpr ValidationRule kImageBufferViewWithBytestride{
    "IMAGE_BUFFER_VIEW_WITH_BYTESTRIDE", FindingSeverity::error,
    "the buffer view of an image must not have a byteStride"};
inline constexpr ValidationRule kIncompleteExtensionSupport{
    "INCOMPLETE_EXTENSION_SUPPORT", FindingSeverity::information,
    "the extension is checked in part only"};
inline constexpr ValidationRule kInvalidIbmAccessorCount{
    "INVALID_IBM_ACCESSOR_COUNT", FindingSeverity::error,
    "there are fewer inverse bind matrices than joints"};
inline constexpr ValidationRule kKhrMaterialsVariantsNonUniqueVariant{
    "KHR_MATERIALS_VARIANTS_NON_UNIQUE_VARIANT", FindingSeverity::error,
    "the primitive maps the variant twice"};
inline constexpr ValidationRule kMeshPrimitiveAccessorUnaligned{
    "MESH_PRIMITIVE_ACCESSOR_UNALIGNED", FindingSeverity::error,
    "vertex attributes must be aligned to 4 bytes"};
inline constexpr ValidationRule kMeshPrimitiveAccessorWithoutBytestride{
    "MESH_PRIMITIVE_ACCESSOR_WITHOUT_BYTESTRIDE", FindingSeverity::error,
    "a buffer view of several attributes needs a byteStride"};
inline constexpr ValidationRule kMeshPrimitiveAttributesAccessorInvalidFormat{
    "MESH_PRIMITIVE_ATTRIBUTES_ACCESSOR_INVALID_FORMAT", FindingSeverity::error,
    "wrong type of accessor for this attribute"};
inline constexpr ValidationRule kMeshPrimitiveAttributesAccessorUnsignedInt{
    "MESH_PRIMITIVE_ATTRIBUTES_ACCESSOR_UNSIGNED_INT", FindingSeverity::error,
    "attributes cannot be 32-bit integers"};
inline constexpr ValidationRule kMeshPrimitiveGeneratedTangentSpace{
    "MESH_PRIMITIVE_GENERATED_TANGENT_SPACE", FindingSeverity::warning,
    "the material needs tangents that the primitive does not have; generated ones may differ"};
inline constexpr ValidationRule kMeshPrimitiveIncompatibleMode{
    "MESH_PRIMITIVE_INCOMPATIBLE_MODE", FindingSeverity::warning,
    "the number of vertices or indices does not fit the mode"};
inline constexpr ValidationRule kMeshPrimitiveIndicesAccessorInvalidFormat{
    "MESH_PRIMITIVE_INDICES_ACCESSOR_INVALID_FORMAT", FindingSeverity::error,
    "indices must be unsigned integer scalars"};
inline constexpr ValidationRule kMeshPrimitiveIndicesAccessorWithBytestride{
    "MESH_PRIMITIVE_INDICES_ACCESSOR_WITH_BYTESTRIDE", FindingSeverity::error,
    "the buffer view of indices must not have a byteStride"};
inline constexpr ValidationRule kMeshPrimitiveMorphTargetInvalidAttributeCount{
    "MESH_PRIMITIVE_MORPH_TARGET_INVALID_ATTRIBUTE_COUNT", FindingSeverity::error,
    "the attribute that it displaces has another count"};
inline constexpr ValidationRule kMeshPrimitiveMorphTargetNoBaseAccessor{
    "MESH_PRIMITIVE_MORPH_TARGET_NO_BASE_ACCESSOR", FindingSeverity::error,
    "the primitive does not have the attribute that it displaces"};
inline constexpr ValidationRule kMeshPrimitiveNoTangentSpace{
    "MESH_PRIMITIVE_NO_TANGENT_SPACE", FindingSeverity::error,
    "the material needs tangents and has no normal texture from which to generate them"};
inline constexpr ValidationRule kMeshPrimitivePositionAccessorWithoutBounds{
    "MESH_PRIMITIVE_POSITION_ACCESSOR_WITHOUT_BOUNDS", FindingSeverity::error,
    "positions need min and max"};
inline constexpr ValidationRule kMeshPrimitiveTooFewTexcoords{
    "MESH_PRIMITIVE_TOO_FEW_TEXCOORDS", FindingSeverity::error,
    "the primitive does not have the texture coordinates of the material"};
inline constexpr ValidationRule kMeshPrimitiveUnequalAccessorCount{
    "MESH_PRIMITIVE_UNEQUAL_ACCESSOR_COUNT", FindingSeverity::error,
    "all attributes of a primitive must have as many elements"};
inline constexpr ValidationRule kNodeLoop{"NODE_LOOP", FindingSeverity::error,
                                          "the node is its own ancestor"};
inline constexpr ValidationRule kNodeParentOverride{"NODE_PARENT_OVERRIDE", FindingSeverity::error,
                                                    "the node has another parent before"};
inline constexpr ValidationRule kNodeSkinnedMeshWithoutSkin{
    "NODE_SKINNED_MESH_WITHOUT_SKIN", FindingSeverity::warning,
    "the mesh has joints, but the node has no skin"};
inline constexpr ValidationRule kNodeSkinWithNonSkinnedMesh{
    "NODE_SKIN_WITH_NON_SKINNED_MESH", FindingSeverity::error,
    "the node has a skin, but the mesh has no joints"};
inline constexpr ValidationRule kNodeWeightsInvalid{
    "NODE_WEIGHTS_INVALID", FindingSeverity::error,
    "the number of weights is not that of the morph targets"};
inline constexpr ValidationRule kSceneNonRootNode{
    "SCENE_NON_ROOT_NODE", FindingSeverity::error,
    "the node has a parent, so it is no root of a scene"};
inline constexpr ValidationRule kSkinIbmAccessorWithBytestride{
    "SKIN_IBM_ACCESSOR_WITH_BYTESTRIDE", FindingSeverity::error,
    "the buffer view of inverse bind matrices must not have a byteStride"};
inline constexpr ValidationRule kSkinIbmInvalidFormat{
    "SKIN_IBM_INVALID_FORMAT", FindingSeverity::error, "inverse bind matrices must be 4x4 floats"};
inline constexpr ValidationRule kTextureInvalidImageMimeType{
    "TEXTURE_INVALID_IMAGE_MIME_TYPE", FindingSeverity::error,
    "a texture cannot use this type of image here"};
inline constexpr ValidationRule kUndeclaredExtension{
    "UNDECLARED_EXTENSION", FindingSeverity::error,
    "the extension is not listed in extensionsUsed"};
inline constexpr ValidationRule kUnexpectedExtensionObject{
    "UNEXPECTED_EXTENSION_OBJECT", FindingSeverity::error,
    "the extension is not defined for this object"};
inline constexpr ValidationRule kUnresolvedReference{"UNRESOLVED_REFERENCE", FindingSeverity::error,
                                                     "there is no such element"};
inline constexpr ValidationRule kUnsupportedExtension{
    "UNSUPPORTED_EXTENSION", FindingSeverity::information, "the extension is not checked"};
inline constexpr ValidationRule kUnusedMeshTangent{
    "UNUSED_MESH_TANGENT", FindingSeverity::information,
    "tangents are not used, as the material has no normal texture"};
inline constexpr ValidationRule kUnusedMeshWeights{"UNUSED_MESH_WEIGHTS",
                                                   FindingSeverity::information,
                                                   "every node of the mesh gives other weights"};
inline constexpr ValidationRule kUnusedObject{"UNUSED_OBJECT", FindingSeverity::information,
                                              "nothing uses this object"};
inline constexpr ValidationRule kAccessorAnimationInputNegative{
    "ACCESSOR_ANIMATION_INPUT_NEGATIVE", FindingSeverity::error, "a time is negative"};
inline constexpr ValidationRule kAccessorAnimationInputNonIncreasing{
    "ACCESSOR_ANIMATION_INPUT_NON_INCREASING", FindingSeverity::error, "times must increase"};
inline constexpr ValidationRule kAccessorAnimationSamplerOutputNonNormalizedQuaternion{
    "ACCESSOR_ANIMATION_SAMPLER_OUTPUT_NON_NORMALIZED_QUATERNION", FindingSeverity::error,
    "a quaternion does not have unit length"};
inline constexpr ValidationRule kAccessorElementOutOfMaxBound{
    "ACCESSOR_ELEMENT_OUT_OF_MAX_BOUND", FindingSeverity::error,
    "elements are above the declared maximum"};
inline constexpr ValidationRule kAccessorElementOutOfMinBound{
    "ACCESSOR_ELEMENT_OUT_OF_MIN_BOUND", FindingSeverity::error,
    "elements are below the declared minimum"};
inline constexpr ValidationRule kAccessorIndexOob{"ACCESSOR_INDEX_OOB", FindingSeverity::error,
                                                  "an index is beyond the last vertex"};
inline constexpr ValidationRule kAccessorIndexPrimitiveRestart{
    "ACCESSOR_INDEX_PRIMITIVE_RESTART", FindingSeverity::error,
    "an index is the value of primitive restart"};
inline constexpr ValidationRule kAccessorIndexTriangleDegenerate{
    "ACCESSOR_INDEX_TRIANGLE_DEGENERATE", FindingSeverity::information,
    "triangles have repeated indices"};
inline constexpr ValidationRule kAccessorInvalidFloat{
    "ACCESSOR_INVALID_FLOAT", FindingSeverity::error, "an element is not a finite number"};
inline constexpr ValidationRule kAccessorInvalidIbm{
    "ACCESSOR_INVALID_IBM", FindingSeverity::error,
    "the last row of an inverse bind matrix is not 0 0 0 1"};
inline constexpr ValidationRule kAccessorInvalidSign{
    "ACCESSOR_INVALID_SIGN", FindingSeverity::error, "w of a tangent is neither 1 nor -1"};
inline constexpr ValidationRule kAccessorJointsIndexDuplicate{
    "ACCESSOR_JOINTS_INDEX_DUPLICATE", FindingSeverity::error, "a vertex names a joint twice"};
inline constexpr ValidationRule kAccessorJointsIndexOob{
    "ACCESSOR_JOINTS_INDEX_OOB", FindingSeverity::error,
    "a joint is beyond the last joint of the skin"};
inline constexpr ValidationRule kAccessorJointsUsedZeroWeight{"ACCESSOR_JOINTS_USED_ZERO_WEIGHT",
                                                              FindingSeverity::warning,
                                                              "a joint other than 0 has weight 0"};
inline constexpr ValidationRule kAccessorMaxMismatch{
    "ACCESSOR_MAX_MISMATCH", FindingSeverity::error,
    "the declared maximum is not that of the elements"};
inline constexpr ValidationRule kAccessorMinMismatch{
    "ACCESSOR_MIN_MISMATCH", FindingSeverity::error,
    "the declared minimum is not that of the elements"};
inline constexpr ValidationRule kAccessorNonClamped{"ACCESSOR_NON_CLAMPED", FindingSeverity::error,
                                                    "a colour is outside 0 to 1"};
inline constexpr ValidationRule kAccessorSparseIndexOob{
    "ACCESSOR_SPARSE_INDEX_OOB", FindingSeverity::error,
    "a sparse index is beyond the last element"};
inline constexpr ValidationRule kAccessorSparseIndicesNonIncreasing{
    "ACCESSOR_SPARSE_INDICES_NON_INCREASING", FindingSeverity::error,
    "sparse indices must increase"};
inline constexpr ValidationRule kAccessorVector3NonUnit{
    "ACCESSOR_VECTOR3_NON_UNIT", FindingSeverity::error, "a vector does not have unit length"};
inline constexpr ValidationRule kAccessorWeightsNegative{
    "ACCESSOR_WEIGHTS_NEGATIVE", FindingSeverity::error, "a weight is negative"};
inline constexpr ValidationRule kAccessorWeightsNonNormalized{
    "ACCESSOR_WEIGHTS_NON_NORMALIZED", FindingSeverity::error,
    "the weights of a vertex do not sum to 1"};
inline constexpr ValidationRule kBufferByteLengthMismatch{
    "BUFFER_BYTE_LENGTH_MISMATCH", FindingSeverity::error, "the data are shorter than byteLength"};
inline constexpr ValidationRule kBufferGlbChunkTooBig{
    "BUFFER_GLB_CHUNK_TOO_BIG", FindingSeverity::warning,
    "the binary chunk is longer than byteLength and its padding"};
inline constexpr ValidationRule kDataUriGlb{"DATA_URI_GLB", FindingSeverity::warning,
                                            "a GLB need not have data URIs"};
inline constexpr ValidationRule kImageDataInvalid{"IMAGE_DATA_INVALID", FindingSeverity::error,
                                                  "the image is damaged"};
inline constexpr ValidationRule kImageFeaturesUnsupported{
    "IMAGE_FEATURES_UNSUPPORTED", FindingSeverity::warning,
    "the image has a colour space, pixel shape or animation that glTF ignores"};
inline constexpr ValidationRule kImageMimeTypeInvalid{
    "IMAGE_MIME_TYPE_INVALID", FindingSeverity::error, "the image is not of the declared type"};
inline constexpr ValidationRule kImageNonEnabledMimeType{
    "IMAGE_NON_ENABLED_MIME_TYPE", FindingSeverity::error, "this type of image needs an extension"};
inline constexpr ValidationRule kImageNpotDimensions{
    "IMAGE_NPOT_DIMENSIONS", FindingSeverity::information, "width or height is no power of two"};
inline constexpr ValidationRule kImageUnexpectedEos{"IMAGE_UNEXPECTED_EOS", FindingSeverity::error,
                                                    "the image is truncated"};
inline constexpr ValidationRule kImageUnrecognizedFormat{
    "IMAGE_UNRECOGNIZED_FORMAT", FindingSeverity::warning,
    "the format of the image is not recognised"};
inline constexpr ValidationRule kUriGlb{"URI_GLB", FindingSeverity::information,
                                        "a GLB need not refer to other files"};
inline constexpr ValidationRule kGlbChunkLengthUnaligned{
    "GLB_CHUNK_LENGTH_UNALIGNED", FindingSeverity::error,
    "the length of a chunk must be a multiple of 4"};
inline constexpr ValidationRule kGlbChunkTooBig{
    "GLB_CHUNK_TOO_BIG", FindingSeverity::error,
    "the chunk does not fit the file's declared length"};
inline constexpr ValidationRule kGlbDuplicateChunk{"GLB_DUPLICATE_CHUNK", FindingSeverity::error,
                                                   "a chunk of this type occurs before"};
inline constexpr ValidationRule kGlbEmptyBinChunk{"GLB_EMPTY_BIN_CHUNK",
                                                  FindingSeverity::information,
                                                  "an empty binary chunk need not be stored"};
inline constexpr ValidationRule kGlbEmptyChunk{"GLB_EMPTY_CHUNK", FindingSeverity::error,
                                               "the JSON chunk is empty"};
inline constexpr ValidationRule kGlbExtraData{"GLB_EXTRA_DATA", FindingSeverity::warning,
                                              "bytes follow the declared length of the file"};
inline constexpr ValidationRule kGlbInvalidMagic{"GLB_INVALID_MAGIC", FindingSeverity::error,
                                                 "the file does not begin with the magic of a GLB"};
inline constexpr ValidationRule kGlbInvalidVersion{"GLB_INVALID_VERSION", FindingSeverity::error,
                                                   "the version of the container is not 2"};
inline constexpr ValidationRule kGlbLengthMismatch{"GLB_LENGTH_MISMATCH", FindingSeverity::error,
                                                   "the declared length is not that of the file"};
inline constexpr ValidationRule kGlbLengthTooSmall{"GLB_LENGTH_TOO_SMALL", FindingSeverity::error,
                                                   "the declared length is too small for a GLB"};
inline constexpr ValidationRule kGlbUnexpectedBinChunk{
    "GLB_UNEXPECTED_BIN_CHUNK", FindingSeverity::error, "the binary chunk must be the second"};
inline constexpr ValidationRule kGlbUnexpectedEndOfChunkData{
    "GLB_UNEXPECTED_END_OF_CHUNK_DATA", FindingSeverity::error, "the file ends within a chunk"};
inline constexpr ValidationRule kGlbUnexpectedEndOfChunkHeader{
    "GLB_UNEXPECTED_END_OF_CHUNK_HEADER", FindingSeverity::error,
    "the file ends within the header of a chunk"};
inline constexpr ValidationRule kGlbUnexpectedEndOfHeader{
    "GLB_UNEXPECTED_END_OF_HEADER", FindingSeverity::error, "the file ends within its header"};
inline constexpr ValidationRule kGlbUnexpectedFirstChunk{
    "GLB_UNEXPECTED_FIRST_CHUNK", FindingSeverity::error, "the first chunk must be JSON"};
inline constexpr ValidationRule kGlbUnknownChunkType{
    "GLB_UNKNOWN_CHUNK_TYPE", FindingSeverity::warning, "unknown type of chunk"};

}  // namespace tessera::render::rules

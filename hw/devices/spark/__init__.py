"""REV SPARK MAX and SPARK Flex motor controllers over CAN."""

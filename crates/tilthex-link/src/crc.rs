//! The CRC-16 of DDS-XRCE and of the messages of a vehicle that flies itself: polynomial 0x8005, reflected bits.

const CRC_TABLE: [u16; 256] = crc_table();

const fn crc_table() -> [u16; 256] {
    let mut table = [0; 256];
    let mut index = 0;
    while index < 256 {
        let mut crc = index as u16;
        let mut bit = 0;
        while bit < 8 {
            crc = if crc & 1 == 1 { crc >> 1 ^ 0xa001 } else { crc >> 1 };
            bit += 1;
        }
        table[index] = crc;
        index += 1;
    }
    table
}

/// The CRC of bytes whose CRC so far is `crc`, and this byte.
pub(crate) fn crc_with(crc: u16, byte: u8) -> u16 {
    let [low, _] = crc.to_le_bytes();
    crc >> 8 ^ CRC_TABLE[usize::from(low ^ byte)]
}

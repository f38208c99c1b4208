/// The STM32G474 registers these images touch (RM0440), and no others.
#ifndef CRUX_STM32G474_REGISTERS_H
#define CRUX_STM32G474_REGISTERS_H

#include <stdint.h>

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define REGISTER16(address) (*(volatile uint16_t *)(address))
#define BIT(n) (1UL << (n))

// Cortex-M4: SysTick, NVIC, reset, coprocessor access.
#define SYST_CSR REGISTER(0xE000E010UL)
#define SYST_RVR REGISTER(0xE000E014UL)
#define SYST_CVR REGISTER(0xE000E018UL)
#define NVIC_ISER0 REGISTER(0xE000E100UL)
#define NVIC_IPR4 REGISTER(0xE000E410UL)  ///< priorities of interrupts 16..19, a byte each, upper four bits used
#define NVIC_IPR5 REGISTER(0xE000E414UL)  ///< 20..23
#define SCB_VTOR REGISTER(0xE000ED08UL)
#define SCB_AIRCR REGISTER(0xE000ED0CUL)
#define SCB_AIRCR_KEY (0x05FAUL << 16)
#define SCB_AIRCR_SYSRESETREQ BIT(2)
#define SCB_SHPR3 REGISTER(0xE000ED20UL)  ///< SysTick in the uppermost byte
#define SCB_CPACR REGISTER(0xE000ED88UL)
#define IRQ_ADC1_2 18U
#define IRQ_FDCAN1_IT0 21U

// Power, flash, clocks.
#define PWR_CR5 REGISTER(0x40007080UL)
#define PWR_CR5_R1MODE BIT(8)
#define FLASH_ACR REGISTER(0x40022000UL)
#define FLASH_ACR_LATENCY_MASK 0xFUL
#define FLASH_ACR_PREFETCH BIT(8)
#define FLASH_ACR_ICACHE BIT(9)
#define FLASH_ACR_DCACHE BIT(10)
#define FLASH_ACR_DCRST BIT(12)
#define FLASH_KEYR REGISTER(0x40022008UL)
#define FLASH_KEY_1 0x45670123UL
#define FLASH_KEY_2 0xCDEF89ABUL
#define FLASH_SR REGISTER(0x40022010UL)
#define FLASH_SR_ERRORS 0xC3FAUL
#define FLASH_SR_BSY BIT(16)
#define FLASH_CR REGISTER(0x40022014UL)
#define FLASH_CR_PG BIT(0)
#define FLASH_CR_PER BIT(1)
#define FLASH_CR_PNB(page) ((page) << 3)
#define FLASH_CR_BKER BIT(11)
#define FLASH_CR_STRT BIT(16)
#define FLASH_CR_LOCK BIT(31)
#define FLASH_ECCR REGISTER(0x40022018UL)
#define FLASH_ECCR_ECCD BIT(31)
#define FLASH_OPTR REGISTER(0x40022020UL)
#define FLASH_OPTR_DBANK BIT(22)
#define RCC_CR REGISTER(0x40021000UL)
#define RCC_CR_HSEON BIT(16)
#define RCC_CR_HSERDY BIT(17)
#define RCC_CR_PLLON BIT(24)
#define RCC_CR_PLLRDY BIT(25)
#define RCC_CFGR REGISTER(0x40021008UL)
#define RCC_CFGR_SW_PLL 3UL
#define RCC_CFGR_SWS_MASK (3UL << 2)
#define RCC_CFGR_SWS_PLL (3UL << 2)
#define RCC_CFGR_HPRE_MASK (0xFUL << 4)
#define RCC_CFGR_HPRE_DIV2 (8UL << 4)
#define RCC_PLLCFGR REGISTER(0x4002100CUL)
#define RCC_PLLCFGR_SRC_HSE 3UL
#define RCC_PLLCFGR_M(divisor) (((divisor) - 1UL) << 4)
#define RCC_PLLCFGR_N(factor) ((factor) << 8)
#define RCC_PLLCFGR_REN BIT(24)  ///< output R, divisor 2
#define RCC_AHB2ENR REGISTER(0x4002104CUL)
#define RCC_AHB2ENR_GPIOA BIT(0)
#define RCC_AHB2ENR_GPIOB BIT(1)
#define RCC_AHB2ENR_GPIOC BIT(2)
#define RCC_AHB2ENR_ADC12 BIT(13)
#define RCC_APB1ENR1 REGISTER(0x40021058UL)
#define RCC_APB1ENR1_FDCAN BIT(25)
#define RCC_APB1ENR1_PWR BIT(28)
#define RCC_APB2ENR REGISTER(0x40021060UL)
#define RCC_APB2ENR_TIM1 BIT(11)
#define RCC_APB2ENR_SPI1 BIT(12)
#define RCC_CCIPR REGISTER(0x40021088UL)
#define RCC_CCIPR_FDCAN_PCLK1 (2UL << 24)

// Independent watchdog.
#define IWDG_KR REGISTER(0x40003000UL)
#define IWDG_PR REGISTER(0x40003004UL)
#define IWDG_RLR REGISTER(0x40003008UL)
#define IWDG_SR REGISTER(0x4000300CUL)
#define IWDG_KR_RELOAD 0xAAAAUL
#define IWDG_KR_UNLOCK 0x5555UL
#define IWDG_KR_START 0xCCCCUL
#define IWDG_PR_32 3UL  ///< 1 kHz of the 32 kHz oscillator

// Ports A, B and C.
#define GPIOA 0x48000000UL
#define GPIOB 0x48000400UL
#define GPIOC 0x48000800UL
#define GPIO_MODER(port) REGISTER((port) + 0x00UL)
#define GPIO_PUPDR(port) REGISTER((port) + 0x0CUL)
#define GPIO_IDR(port) REGISTER((port) + 0x10UL)
#define GPIO_BSRR(port) REGISTER((port) + 0x18UL)
#define GPIO_AFRL(port) REGISTER((port) + 0x20UL)
#define GPIO_AFRH(port) REGISTER((port) + 0x24UL)
#define GPIO_MODE_INPUT 0UL
#define GPIO_MODE_OUTPUT 1UL
#define GPIO_MODE_ALTERNATE 2UL
#define GPIO_MODE_ANALOG 3UL
#define GPIO_PULL_UP 1UL
#define GPIO_PULL_DOWN 2UL

// Timer 1.
#define TIM1_CR1 REGISTER(0x40012C00UL)
#define TIM1_CR2 REGISTER(0x40012C04UL)
#define TIM1_SR REGISTER(0x40012C10UL)
#define TIM1_EGR REGISTER(0x40012C14UL)
#define TIM1_CCMR1 REGISTER(0x40012C18UL)
#define TIM1_CCMR2 REGISTER(0x40012C1CUL)
#define TIM1_CCER REGISTER(0x40012C20UL)
#define TIM1_ARR REGISTER(0x40012C2CUL)
#define TIM1_RCR REGISTER(0x40012C30UL)
#define TIM1_CCR1 REGISTER(0x40012C34UL)
#define TIM1_CCR2 REGISTER(0x40012C38UL)
#define TIM1_CCR3 REGISTER(0x40012C3CUL)
#define TIM1_BDTR REGISTER(0x40012C44UL)
#define TIM_CR1_CEN BIT(0)
#define TIM_CR1_CMS_BOTH (3UL << 5)  ///< centre-aligned
#define TIM_CR2_OIS1N BIT(9)
#define TIM_CR2_OIS2N BIT(11)
#define TIM_CR2_OIS3N BIT(13)
#define TIM_CR2_MMS2_UPDATE (2UL << 20)
#define TIM_SR_BIF BIT(7)
#define TIM_EGR_UG BIT(0)
#define TIM_CCMR1_OC1PE BIT(3)
#define TIM_CCMR1_OC1M_PWM1 (6UL << 4)
#define TIM_CCMR1_OC2PE BIT(11)
#define TIM_CCMR1_OC2M_PWM1 (6UL << 12)
#define TIM_CCMR2_OC3PE BIT(3)
#define TIM_CCMR2_OC3M_PWM1 (6UL << 4)
#define TIM_CCER_CC1E BIT(0)
#define TIM_CCER_CC1NE BIT(2)
#define TIM_CCER_CC2E BIT(4)
#define TIM_CCER_CC2NE BIT(6)
#define TIM_CCER_CC3E BIT(8)
#define TIM_CCER_CC3NE BIT(10)
#define TIM_BDTR_DTG(cycles) (cycles)
#define TIM_BDTR_OSSI BIT(10)
#define TIM_BDTR_OSSR BIT(11)
#define TIM_BDTR_BKE BIT(12)
#define TIM_BDTR_AOE BIT(14)
#define TIM_BDTR_MOE BIT(15)
#define TIM_BDTR_BKF(filter) ((filter) << 16)

// ADC 1 and 2.
#define ADC1 0x50000000UL
#define ADC2 0x50000100UL
#define ADC_ISR(adc) REGISTER((adc) + 0x00UL)
#define ADC_IER(adc) REGISTER((adc) + 0x04UL)
#define ADC_CR(adc) REGISTER((adc) + 0x08UL)
#define ADC_SMPR1(adc) REGISTER((adc) + 0x14UL)
#define ADC_SQR1(adc) REGISTER((adc) + 0x30UL)
#define ADC_DR(adc) REGISTER((adc) + 0x40UL)
#define ADC_JSQR(adc) REGISTER((adc) + 0x4CUL)
#define ADC_JDR1(adc) REGISTER((adc) + 0x80UL)
#define ADC12_CCR REGISTER(0x50000308UL)
#define ADC_ISR_ADRDY BIT(0)
#define ADC_IER_JEOCIE BIT(5)
#define ADC_CR_ADEN BIT(0)
#define ADC_CR_ADSTART BIT(2)
#define ADC_CR_JADSTART BIT(3)
#define ADC_CR_ADVREGEN BIT(28)
#define ADC_CR_ADCAL BIT(31)
#define ADC_SMPR1_SMP(channel, cycles) ((cycles) << (3UL * (channel)))
#define ADC_SQR1_SQ1(channel) ((channel) << 6)
#define ADC_JSQR_JEXTSEL_TIM1_TRGO2 (8UL << 2)
#define ADC_JSQR_JEXTEN_RISING (1UL << 7)
#define ADC_JSQR_JSQ1(channel) ((channel) << 9)
#define ADC12_CCR_CKMODE_HCLK_4 (3UL << 16)
#define ADC_SAMPLE_12_CYCLES 2UL
#define ADC_SAMPLE_247_CYCLES 6UL

// SPI 1.
#define SPI1_CR1 REGISTER(0x40013000UL)
#define SPI1_CR2 REGISTER(0x40013004UL)
#define SPI1_SR REGISTER(0x40013008UL)
#define SPI1_DR REGISTER16(0x4001300CUL)
#define SPI_CR1_CPHA BIT(0)
#define SPI_CR1_MSTR BIT(2)
#define SPI_CR1_BR_32 (4UL << 3)  ///< clock / 32
#define SPI_CR1_SPE BIT(6)
#define SPI_CR1_SSI BIT(8)
#define SPI_CR1_SSM BIT(9)
#define SPI_CR2_DS_16 (15UL << 8)
#define SPI_SR_RXNE BIT(0)

// FDCAN 1 and 2 and their message RAMs (fixed layout: 28 + 8 filters, two FIFOs of 3, 3 transmit events, 3 transmit
// buffers).
#define FDCAN1 0x40006400UL
#define FDCAN2 0x40006800UL
#define FDCAN1_RAM 0x4000A400UL
#define FDCAN2_RAM 0x4000A750UL
#define FDCAN_DBTP(can) REGISTER((can) + 0x0CUL)
#define FDCAN_CCCR(can) REGISTER((can) + 0x18UL)
#define FDCAN_NBTP(can) REGISTER((can) + 0x1CUL)
#define FDCAN_PSR(can) REGISTER((can) + 0x44UL)
#define FDCAN_TDCR(can) REGISTER((can) + 0x48UL)
#define FDCAN_IR(can) REGISTER((can) + 0x50UL)
#define FDCAN_IE(can) REGISTER((can) + 0x54UL)
#define FDCAN_ILS(can) REGISTER((can) + 0x58UL)
#define FDCAN_ILE(can) REGISTER((can) + 0x5CUL)
#define FDCAN_RXGFC(can) REGISTER((can) + 0x80UL)
#define FDCAN_RXF0S(can) REGISTER((can) + 0x90UL)
#define FDCAN_RXF0A(can) REGISTER((can) + 0x94UL)
#define FDCAN_TXFQS(can) REGISTER((can) + 0xC4UL)
#define FDCAN_TXBRP(can) REGISTER((can) + 0xC8UL)
#define FDCAN_TXBAR(can) REGISTER((can) + 0xCCUL)
#define FDCAN_CCCR_INIT BIT(0)
#define FDCAN_CCCR_CCE BIT(1)
#define FDCAN_CCCR_FDOE BIT(8)
#define FDCAN_CCCR_BRSE BIT(9)
#define FDCAN_PSR_BO BIT(7)
#define FDCAN_DBTP_TDC BIT(23)
#define FDCAN_IR_RF0N BIT(0)
#define FDCAN_RXGFC_REJECT_REMOTE (BIT(0) | BIT(1))
#define FDCAN_RXGFC_REJECT_OTHERS ((2UL << 2) | (2UL << 4))
#define FDCAN_RXGFC_STANDARD_FILTERS(count) ((count) << 16)
#define FDCAN_TXFQS_FULL BIT(21)
#define FDCAN_FILTER(ram, index) REGISTER((ram) + (4UL * (index)))
#define FDCAN_FILTER_TWO_IDS_TO_FIFO0(a, b) ((1UL << 30) | (1UL << 27) | ((a) << 16) | (b))
#define FDCAN_ELEMENT_WORDS 18U
#define FDCAN_RX_FIFO0(ram, index) ((volatile uint32_t *)((ram) + 0x0B0UL + (4UL * FDCAN_ELEMENT_WORDS * (index))))
#define FDCAN_TX_BUFFER(ram, index) ((volatile uint32_t *)((ram) + 0x278UL + (4UL * FDCAN_ELEMENT_WORDS * (index))))

#endif

/// The STM32G474 registers these images touch (RM0440), and no others.
#ifndef CRUX_STM32G474_REGISTERS_H
#define CRUX_STM32G474_REGISTERS_H

#include <stdint.h>

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define BIT(n) (1UL << (n))

// Cortex-M4: SysTick, NVIC, coprocessor access.
#define SYST_CSR REGISTER(0xE000E010UL)
#define SYST_RVR REGISTER(0xE000E014UL)
#define SYST_CVR REGISTER(0xE000E018UL)
#define NVIC_ISER0 REGISTER(0xE000E100UL)
#define SCB_CPACR REGISTER(0xE000ED88UL)
#define IRQ_FDCAN1_IT0 21U

// Power, flash, clocks.
#define PWR_CR5 REGISTER(0x40007080UL)
#define PWR_CR5_R1MODE BIT(8)
#define FLASH_ACR REGISTER(0x40022000UL)
#define FLASH_ACR_LATENCY_MASK 0xFUL
#define FLASH_ACR_PREFETCH BIT(8)
#define FLASH_ACR_ICACHE BIT(9)
#define FLASH_ACR_DCACHE BIT(10)
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
#define RCC_AHB2ENR_GPIOC BIT(2)
#define RCC_AHB2ENR_ADC12 BIT(13)
#define RCC_APB1ENR1 REGISTER(0x40021058UL)
#define RCC_APB1ENR1_TIM2 BIT(0)
#define RCC_APB1ENR1_FDCAN BIT(25)
#define RCC_APB1ENR1_PWR BIT(28)
#define RCC_APB2ENR REGISTER(0x40021060UL)
#define RCC_APB2ENR_TIM1 BIT(11)
#define RCC_CCIPR REGISTER(0x40021088UL)
#define RCC_CCIPR_FDCAN_PCLK1 (2UL << 24)

// Ports A and C.
#define GPIOA 0x48000000UL
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

// Timers.
#define TIM1 0x40012C00UL
#define TIM2 0x40000000UL
#define TIM_CR1(timer) REGISTER((timer) + 0x00UL)
#define TIM_SMCR(timer) REGISTER((timer) + 0x08UL)
#define TIM_EGR(timer) REGISTER((timer) + 0x14UL)
#define TIM_CCMR1(timer) REGISTER((timer) + 0x18UL)
#define TIM_CCER(timer) REGISTER((timer) + 0x20UL)
#define TIM_CNT(timer) REGISTER((timer) + 0x24UL)
#define TIM_ARR(timer) REGISTER((timer) + 0x2CUL)
#define TIM_CCR1(timer) REGISTER((timer) + 0x34UL)
#define TIM_BDTR(timer) REGISTER((timer) + 0x44UL)
#define TIM_CR1_CEN BIT(0)
#define TIM_EGR_UG BIT(0)
#define TIM_SMCR_ENCODER_BOTH 3UL
#define TIM_CCMR1_INPUTS (BIT(0) | BIT(8))                   ///< CC1 on TI1, CC2 on TI2
#define TIM_CCMR1_PWM1_PRELOADED (BIT(3) | BIT(5) | BIT(6))  ///< OC1PE, OC1M = 110
#define TIM_CCER_CC1E BIT(0)
#define TIM_BDTR_MOE BIT(15)

// ADC 1.
#define ADC1_ISR REGISTER(0x50000000UL)
#define ADC1_CR REGISTER(0x50000008UL)
#define ADC1_SMPR1 REGISTER(0x50000014UL)
#define ADC1_SMPR2 REGISTER(0x50000018UL)
#define ADC1_SQR1 REGISTER(0x50000030UL)
#define ADC1_DR REGISTER(0x50000040UL)
#define ADC12_CCR REGISTER(0x50000308UL)
#define ADC_ISR_ADRDY BIT(0)
#define ADC_ISR_EOC BIT(2)
#define ADC_CR_ADEN BIT(0)
#define ADC_CR_ADSTART BIT(2)
#define ADC_CR_ADVREGEN BIT(28)
#define ADC_CR_ADCAL BIT(31)
#define ADC12_CCR_CKMODE_HCLK_4 (3UL << 16)
#define ADC12_CCR_VSENSESEL BIT(23)
#define ADC_SAMPLE_640_CYCLES 7UL

// Factory calibration of the temperature sensor: raw 12-bit readings at 30 and 110 degC with 3.0 V reference.
#define TS_CAL1 (*(const volatile uint16_t *)0x1FFF75A8UL)
#define TS_CAL2 (*(const volatile uint16_t *)0x1FFF75CAUL)

// FDCAN 1 and its message RAM (fixed layout: 28 + 8 filters, two FIFOs of 3, 3 transmit events, 3 transmit buffers).
#define FDCAN1 0x40006400UL
#define FDCAN_DBTP REGISTER(FDCAN1 + 0x0CUL)
#define FDCAN_CCCR REGISTER(FDCAN1 + 0x18UL)
#define FDCAN_NBTP REGISTER(FDCAN1 + 0x1CUL)
#define FDCAN_PSR REGISTER(FDCAN1 + 0x44UL)
#define FDCAN_TDCR REGISTER(FDCAN1 + 0x48UL)
#define FDCAN_IR REGISTER(FDCAN1 + 0x50UL)
#define FDCAN_IE REGISTER(FDCAN1 + 0x54UL)
#define FDCAN_ILS REGISTER(FDCAN1 + 0x58UL)
#define FDCAN_ILE REGISTER(FDCAN1 + 0x5CUL)
#define FDCAN_RXGFC REGISTER(FDCAN1 + 0x80UL)
#define FDCAN_RXF0S REGISTER(FDCAN1 + 0x90UL)
#define FDCAN_RXF0A REGISTER(FDCAN1 + 0x94UL)
#define FDCAN_TXFQS REGISTER(FDCAN1 + 0xC4UL)
#define FDCAN_TXBAR REGISTER(FDCAN1 + 0xCCUL)
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
#define FDCAN_FILTER(index) REGISTER(0x4000A400UL + (4UL * (index)))
#define FDCAN_FILTER_TWO_IDS_TO_FIFO0(a, b) ((1UL << 30) | (1UL << 27) | ((a) << 16) | (b))
#define FDCAN_ELEMENT_WORDS 18U
#define FDCAN_RX_FIFO0(index) ((volatile uint32_t *)(0x4000A4B0UL + (4UL * FDCAN_ELEMENT_WORDS * (index))))
#define FDCAN_TX_BUFFER(index) ((volatile uint32_t *)(0x4000A678UL + (4UL * FDCAN_ELEMENT_WORDS * (index))))

#endif

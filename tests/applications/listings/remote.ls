/PROG  REMOTE
/ATTR
OWNER		= MNEDITOR;
COMMENT		= "";
PROG_SIZE	= 1204;
PROTECT		= READ_WRITE;
TCD:  STACK_SIZE	= 0,
      TASK_PRIORITY	= 50;
DEFAULT_GROUP	= 1,*,*,*,*;
CONTROL_CODE	= 00000000 00000000;
/APPL
/MN
   1:  UTOOL_NUM=3 ;
   2:J P[1] 20% FINE    ;
   3:L P[2] 200mm/sec FINE RTCP    ;
   4:L P[3] 200mm/sec CNT50 RTCP    ;
   5:J P[1] 20% FINE    ;
/POS
P[1]{
   GP1:
	UF : 2, UT : 3,	
	J1=    27.252 deg,	J2=    35.150 deg,	J3=    -7.038 deg,
	J4=    -1.946 deg,	J5=    58.403 deg,	J6=    10.724 deg
};
P[2]{
   GP1:
	UF : 2, UT : 3,		CONFIG : 'N U T, 0, 0, 0',
	RX =    60.000  mm,	RY =   470.000  mm,	RZ =   110.000  mm,
	RW =   -65.000 deg,	RP =     1.000 deg,	RR =   -97.000 deg
};
P[3]{
   GP1:
	UF : 2, UT : 3,		CONFIG : 'N U T, 0, 0, 0',
	X =   -20.867  mm,	Y =  1844.280  mm,	Z =  2074.074  mm,
	W =   -55.037 deg,	P =   -46.969 deg,	R =   131.439 deg
};
/END
